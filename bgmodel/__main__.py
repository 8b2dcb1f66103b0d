"""``python -m bgmodel``: the command, where its script is not on the path."""

import sys

from bgmodel.cli import main

if __name__ == "__main__":
    sys.exit(main())
