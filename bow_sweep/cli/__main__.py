"""``python -m bow_sweep.cli``: the command `bow`."""

import sys

from bow_sweep.start import command

if __name__ == "__main__":
    sys.exit(command())
