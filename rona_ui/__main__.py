"""``python -m rona_ui``: the command line."""

import sys

from rona_ui.cli import main

if __name__ == "__main__":
    sys.exit(main())
