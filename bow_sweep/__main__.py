"""``python -m bow_sweep``: the command `bow`."""

import sys

from bow_sweep.entry import command

if __name__ == "__main__":
    sys.exit(command())
