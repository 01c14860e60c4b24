"""Tables for real-time renderers, filled from a solved field."""
