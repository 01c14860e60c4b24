"""Fixtures of more than one file."""

from rendering import plain, table
from sweeping import log, toy

__all__ = ["log", "plain", "table", "toy"]
