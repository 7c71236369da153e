"""Body process of a run: `python -m skinnet.body`."""

import sys

from skinnet.runtime.worker import main

sys.exit(main("skinnet.body"))
