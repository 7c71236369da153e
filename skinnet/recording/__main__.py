"""Recorder process of a run: `python -m skinnet.recording`."""

import sys

from skinnet.worker import main

sys.exit(main("skinnet.recording"))
