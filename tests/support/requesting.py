"""Requests to a run, by the command line."""

import subprocess
import sys

from locations import ROOT


def request(*arguments: str) -> tuple[int, str]:
    """Exit code and the one line that `skinnet request` prints."""
    line = [sys.executable, "-m", "skinnet.cli", "request", *arguments, "--timeout", "60"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=120, cwd=ROOT)
    (said,) = (done.stdout + done.stderr).splitlines()
    return done.returncode, said
