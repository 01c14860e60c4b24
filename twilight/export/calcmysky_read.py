"""A folder of the layout `calcmysky` read back, as the program's shaders put its sky together.

    luminance = multiple-scattering + P(scattering angle) aerosols

both linear between texels, P from the code of the scatterer in params.atmo.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.errors import TwilightError
from twilight.export.values import read_phase
from twilight.solvers.tables.mapping import BRUNETON_2017, Mapping
from twilight.solvers.tables.passes import read

_NUMBER = r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?"
SIZE_KEYS = tuple(f"scattering texture size for {axis}" for axis in ("VZA", "dot(view,sun)", "SZA", "altitude"))


@dataclass(frozen=True)
class Folder:
    """rest, aerosols (altitude, SZA, dot, VZA, 4): X, Y, Z and scotopic luminance [cd m^-2], float32.

    mapping: of their axes; phase (N,): phase function of the aerosol [sr^-1] at angles pi u^2; others: sizes of every
    other .f32 file by name.
    """

    mapping: Mapping
    rest: np.ndarray
    aerosols: np.ndarray
    phase: np.ndarray
    others: dict[str, tuple[int, ...]]

    def luminance(self, height_km: float, sun_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2] (D, 4) of directions (D,), without the ground in view.

        height_km: above the ground; azimuth_deg: from the sun.
        """
        e, a = np.broadcast_arrays(np.atleast_1d(np.radians(elevation_deg)), np.radians(azimuth_deg))
        s = math.radians(sun_deg)
        mu, mu_s = np.ascontiguousarray(np.sin(e)), np.full(e.size, math.sin(s))
        nu = mu * mu_s + np.cos(e) * math.cos(s) * np.cos(a)
        r = self.mapping.bottom_km + height_km
        ground = mu < -math.sqrt(height_km * (2.0 * self.mapping.bottom_km + height_km)) / r
        out = np.zeros((2, e.size, 4))
        for part, table in zip(out, (self.rest, self.aerosols), strict=True):
            read(self.mapping, table, False, np.full(e.size, height_km), mu, mu_s, nu, ground, part, 0, e.size)
        return out[0] + read_phase(self.phase[:, None], nu) * out[1]


def load(folder: str | Path) -> Folder:
    """The tables of a folder.

    Errors: TwilightError for a folder that does not hold them whole.
    """
    folder = Path(folder)
    try:
        text = (folder / "params.atmo").read_text(encoding="utf-8")
        sizes = tuple(int(_value(text, key)) for key in SIZE_KEYS)
        radius, thickness = _value(text, "Earth radius"), _value(text, "atmosphere height")
        code = text[text.index("phase function:") :]
        nodes = code[code.index("](") + 2 : code.index(");")].split(",")
        tables = []
        for name in ("multiple-scattering-xyzw.f32", "single-scattering/aerosols-xyzw.f32"):
            found, values = _texture(folder / name, 4)
            if found != sizes:
                raise ValueError(f"{name} has sizes {found}, params.atmo says {sizes}")
            tables.append(values)
        known = {"multiple-scattering-xyzw.f32", "single-scattering/aerosols-xyzw.f32"}
        names = [str(path.relative_to(folder)) for path in sorted(folder.rglob("*.f32"))]
        others = {name: _texture(folder / name, 2)[0] for name in names if name not in known}
    except (OSError, ValueError) as error:
        raise TwilightError(f"{folder}: does not hold whole tables ({error})") from None
    vza, dot, sza, altitude = sizes
    mapping = Mapping(BRUNETON_2017, radius, thickness, -1.0, altitude, vza, sza, dot, 2, 2, 2, 2)
    rest, aerosols = tables
    return Folder(mapping, rest, aerosols, np.exp([float(v) for v in nodes]), others)


def _value(text: str, key: str) -> float:
    found = re.search(rf"^{re.escape(key)}: ({_NUMBER})", text, re.MULTILINE)
    if found is None:
        raise ValueError(f"params.atmo has no number for {key}")
    return float(found[1])


def _texture(path: Path, dimensions: int) -> tuple[tuple[int, ...], np.ndarray]:
    """Sizes and values (last size, ..., first size, 4) of a .f32 file."""
    sizes = tuple(int(v) for v in np.fromfile(path, "<u2", dimensions))
    values = np.fromfile(path, "<f4", offset=2 * dimensions)
    if len(sizes) < dimensions or values.size != 4 * math.prod(sizes):
        raise ValueError(f"{path.name} holds {values.size} numbers, its sizes are {sizes}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path.name} holds numbers that are not finite")
    return sizes, values.reshape(*sizes[::-1], 4).astype(np.float32, copy=False)
