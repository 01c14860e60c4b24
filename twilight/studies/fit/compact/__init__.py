"""A compact sky: computed skies of one climate, decomposed into a few arrays."""
