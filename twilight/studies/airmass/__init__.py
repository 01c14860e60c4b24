"""Air-mass factors: what a vertical column of an absorber does to scattered sunlight."""
