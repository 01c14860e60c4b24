"""Fluxes of light at any altitude and sun, and what the air does with them: heating, photolysis."""
