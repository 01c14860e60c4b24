"""A sky in a browser: one HTML file that holds the tables of a field and the program that draws them."""

from twilight.viewer.page import Page
from twilight.viewer.scene import check_altitudes, ground_to_orbit, view_fields, view_sky

__all__ = ["Page", "check_altitudes", "ground_to_orbit", "view_fields", "view_sky"]
