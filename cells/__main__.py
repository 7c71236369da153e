"""Entry point of a cell process: `python -m cells`."""

import sys

from skinnet.runtime.worker import main

sys.exit(main("cells"))
