"""Error against run time of `zones` on scenes, searched over its settings: points, frontier, picture."""
