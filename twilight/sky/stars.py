"""The bright stars of Hipparcos, moved to a date, and blended as a camera that cannot resolve them sees them."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cache

import numpy as np

from twilight.base.shipped_data import data_file, data_rows

EPOCH = 1991.25
"""Julian year of the catalogue's positions."""
_MAS = np.pi / 180.0 / 3.6e6
"""One thousandth of an arcsecond [rad]."""


@dataclass(frozen=True, eq=False)
class Stars:
    """Point sources on a sphere, brightest first.

    directions (N, 3): unit vectors in whatever frame the maker says.  magnitude (N,).
    hip (N,): Hipparcos number, 0 for a planet.  names (N,): proper names, empty where there is none.
    """

    directions: np.ndarray
    magnitude: np.ndarray
    hip: np.ndarray
    names: np.ndarray

    def __len__(self) -> int:
        return len(self.magnitude)

    def take(self, chosen: np.ndarray) -> Stars:
        """The stars of these indices, or where this mask is true."""
        return Stars(self.directions[chosen], self.magnitude[chosen], self.hip[chosen], self.names[chosen])

    def turned(self, directions: np.ndarray) -> Stars:
        """The same stars in another frame."""
        return Stars(directions, self.magnitude, self.hip, self.names)

    def label(self, i: int) -> str:
        """The proper name, `HIP n` without one."""
        return str(self.names[i]) or f"HIP {self.hip[i]}"


@cache
def _table() -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data_file("stars/hipparcos2_bright.npz").read_bytes())) as stored:
        table = {name: stored[name] for name in stored.files}
    names = {int(row["hip"]): row["name"] for row in data_rows("stars/names.csv")}
    table["name"] = np.array([names.get(int(hip), "") for hip in table["hip"]])
    return table


def bright_stars(year: float, faintest_mag: float = 6.6) -> Stars:
    """Stars up to `faintest_mag` (Hp, at most 6.6) in the axes of the ICRS, with proper motion up to a Julian year.

    Motion along a great circle's tangent: good to 0.1 arcsec over a century for all but a few stars (radial velocity
    and parallax are left out).
    """
    table = _table()
    n = int(np.searchsorted(table["hp_mag"], faintest_mag, side="right"))
    ra, dec = np.radians(table["ra_deg"][:n]), np.radians(table["dec_deg"][:n])
    outwards = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros(n)], axis=-1)
    north = np.cross(outwards, east)
    by_ra, by_dec = (
        ((year - EPOCH) * _MAS * table[f"pm_{axis}_mas_per_year"][:n].astype(float))[:, None] for axis in ("ra", "dec")
    )
    moved = outwards + by_ra * east + by_dec * north
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return Stars(moved, table["hp_mag"][:n].astype(float), table["hip"][:n], table["name"][:n])


def colour_index(faintest_mag: float = 6.6) -> np.ndarray:
    """B - V [mag] of the stars of `bright_stars`, in its order."""
    table = _table()
    n = int(np.searchsorted(table["hp_mag"], faintest_mag, side="right"))
    return table["b_v_mag"][:n].astype(float)


def blended(stars: Stars, resolution_rad: float) -> Stars:
    """Stars closer together than the resolution become one, named after the brightest, at their centre of light."""
    from scipy.spatial import cKDTree  # start-up

    stars = stars.take(np.argsort(stars.magnitude, kind="stable"))
    pairs = cKDTree(stars.directions).query_pairs(2.0 * np.sin(0.5 * resolution_rad), output_type="ndarray")
    pairs = np.sort(pairs, axis=1)
    free = np.ones(len(stars), dtype=bool)
    light = 10.0 ** (-0.4 * stars.magnitude)
    moment = light[:, None] * stars.directions
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:  # the brightest first
        if free[i] and free[j]:
            free[j] = False
            light[i] += light[j]
            moment[i] += moment[j]
    directions = moment / np.linalg.norm(moment, axis=1, keepdims=True)
    made = Stars(directions, -2.5 * np.log10(light), stars.hip, stars.names).take(free)
    return made.take(np.argsort(made.magnitude, kind="stable"))
