"""What moves, from the tables of fields: a sky in a browser, and films of many skies.

- `skies`: from fields, or one sky, to a `page.Page`: one HTML file with their tables and the program in `web`.
- `page`, `space`, `tones`: what a page holds; `shader`: the same sky as GLSL and WGSL for other programs.
- `film`: from a configuration to its pictures; `timeline` has their suns and exposures, `draw` one picture, `night`
  what shines after dusk, `encode` the encoder.
"""
