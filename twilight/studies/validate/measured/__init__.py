"""Computed light against photometers: illuminance of the ground, luminance of the zenith."""
