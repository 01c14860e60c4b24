"""Photographs: what of one is clear sky, how a computed sky compares, and which air makes the sky that it shows."""
