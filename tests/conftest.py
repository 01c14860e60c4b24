"""Fixtures of more than one file; no test finds a field that another one, or the user, has left on disk."""

import os

from sweeping import log, toy

os.environ["TWILIGHT_CACHE_GB"] = "0"

__all__ = ["log", "toy"]
