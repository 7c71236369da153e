"""Controller process of a run, started by `python -m controller`."""

import sys

from skinnet.runtime.worker import main

sys.exit(main("controller"))
