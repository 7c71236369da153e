"""Settings of all tests."""

import os
import signal
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

# The first call of compiled code compiles it: how long an example takes says nothing. In CI the examples are
# the same in every run; at a desk they are new ones.
settings.register_profile("skinnet", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("skinnet")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell leaves it to what it starts with &
    signal.signal(signal.SIGINT, signal.default_int_handler)  # processes of the tests must hear Ctrl-C


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A Chromium for the tests of a module that look at a page; they are skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    from browsing import ARGUMENTS, CHROMIUM

    if CHROMIUM is None:
        pytest.skip("needs Chromium; set CHROMIUM to its path")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield chromium
        chromium.close()
