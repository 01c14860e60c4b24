"""Sweeps: many skies, computed field by field on Dask, into one dataset that can be interrupted and continued."""
