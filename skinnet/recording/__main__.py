"""Recorder process of a run: `python -m skinnet.recording`."""

import sys

from skinnet.runtime.worker import main

sys.exit(main("skinnet.recording"))
