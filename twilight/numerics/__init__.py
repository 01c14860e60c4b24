"""Functions of numbers: geometry, projections, phase functions, grids, interpolation, spectra."""
