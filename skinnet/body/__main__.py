"""Body process of a run: `python -m skinnet.body`."""

import sys

from skinnet.worker import main

sys.exit(main("skinnet.body"))
