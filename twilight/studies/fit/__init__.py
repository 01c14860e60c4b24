"""Analytic models fitted to computed skies."""
