"""Entry point of a cell process: `python -m cells`."""

import sys

from skinnet.worker import main

sys.exit(main("cells"))
