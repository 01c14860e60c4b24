"""What moves, from the tables of fields: a sky in a browser, and films of many skies.

- `skies`: from fields, or one sky, to a `Page`: one HTML file with their tables and the program in `web` that draws.
- `tables`, `space`, `moonlight`, `tones`: what a page holds; `shader`: the same sky as GLSL for others' programs.
- `film`: from a configuration to its pictures, exposed smoothly and continued where they were interrupted; `timeline`
  has their moments, `draw` one picture, `night` what shines after dusk, `encode` the encoder.
"""
