"""An evening as a table: quantities over time, the moments at which they pass a value, files and a figure."""
