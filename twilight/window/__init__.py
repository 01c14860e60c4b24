"""A sky in a browser: one HTML file that holds the tables of a field and the program that draws them."""

from twilight.window.page import View
from twilight.window.scene import check_altitudes, ground_to_orbit, view_field, view_fields, view_sky

__all__ = ["View", "check_altitudes", "ground_to_orbit", "view_field", "view_fields", "view_sky"]
