"""From a scene to light, the one way for whatever shows, stores or measures it.

    Scene --plan--> blocks of wavelengths --solve--> Field --> SkyTable --> Sky

- `problem`: how a scene is solved, its blocks of wavelengths, their memory and time; `block`: one of them, solved.
- `table` fills a `SkyTable` with light under one sun, `sun_tables` what is read under many; `one_sun` gathers the
  blocks.
- `field`: `Field`, which answers for any sun, observer and direction; `solve` solves all blocks, `parts` one by one.
- `frames`: the skies of a configuration as sums of its lights (`Scene.lights`), with `view` (pictures from anywhere)
  and `sunbeam` (beams and discs).
- `light`: the same sum at many places and times, on directions and surfaces.
"""

from twilight.engine.field import Field, Part, parts, solve
from twilight.engine.frames import Frame, frames, run
from twilight.engine.problem import check_size, full_cost, plan
from twilight.engine.sunbeam import Direct, Sunbeam

__all__ = [
    "Direct",
    "Field",
    "Frame",
    "Part",
    "Sunbeam",
    "check_size",
    "frames",
    "full_cost",
    "parts",
    "plan",
    "run",
    "solve",
]
