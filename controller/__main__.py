"""Controller process of a run, started by `python -m controller`."""

import sys

from skinnet.worker import main

sys.exit(main("controller"))
