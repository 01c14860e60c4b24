"""Analytic skies: formulae instead of a computation, for comparison and as the form of fits.

``preetham`` and ``cie`` are solvers; the other modules hold what they are made of.
"""
