"""Computed skies against photographs and measurements."""
