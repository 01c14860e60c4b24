"""Training sets: skies of drawn airs under many suns, in parts by air, from a sweep; and their loader."""

from twilight.studies.dataset.loader import SkyDataset

__all__ = ["SkyDataset"]
