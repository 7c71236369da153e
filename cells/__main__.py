"""`python -m cells`: a cell host process of a run."""

import sys

from skinnet.worker import main

sys.exit(main("cells"))
