"""Computed skies against measurements and photographs: one package for each kind of evidence, none imports another."""
