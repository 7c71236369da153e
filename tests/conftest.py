"""Settings of all tests."""

import os

from hypothesis import settings

# The first call of compiled code compiles it: how long an example takes says nothing. In CI the examples are
# the same in every run; at a desk they are new ones.
settings.register_profile("skinnet", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("skinnet")
