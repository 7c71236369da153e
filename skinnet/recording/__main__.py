"""`python -m skinnet.recording`: the recorder of a run."""

import sys

from skinnet.worker import main

sys.exit(main("skinnet.recording"))
