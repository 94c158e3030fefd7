"""Exit statuses of the command `bow` and of its child processes."""

DONE = 0
FAILED = 1
"""Also: what was checked is not as it should be."""

USAGE = 2
"""Wrong arguments, or a wrong environment: nothing was done. argparse uses the same number."""

QUARANTINED = 3
"""A sweep is done, but for blocks that were given up."""

INTERRUPTED = 130
"""After Ctrl-C or SIGTERM; shells report 128 + SIGINT."""
