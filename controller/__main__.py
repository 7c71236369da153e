"""`python -m controller`: the controller process of a run."""

import sys

from skinnet.worker import main

sys.exit(main("controller"))
