"""Cameras calibrated from the stars of a night exposure."""
