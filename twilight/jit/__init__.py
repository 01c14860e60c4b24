"""Compiled kernels: the decorator, eight wavelengths in one register."""
