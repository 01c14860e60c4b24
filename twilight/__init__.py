"""Spectral radiance of the whole clear sky, from full day to the last light of astronomical twilight."""

__version__ = "0.1.0"
