"""Air, gases, aerosols, refraction and layers: everything that a medium is made of."""
