"""Fixtures of more than one file."""

from sweeping import log, toy

__all__ = ["log", "toy"]
