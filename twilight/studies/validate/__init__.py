"""Computed skies against what was seen: one package for each kind of evidence, none of which knows another."""
