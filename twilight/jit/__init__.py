"""Compiled kernels: the decorator, eight wavelengths in one register, kernels that a second process compiles."""
