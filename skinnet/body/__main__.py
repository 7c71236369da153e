"""`python -m skinnet.body`: the body process of a run."""

import sys

from skinnet.worker import main

sys.exit(main("skinnet.body"))
