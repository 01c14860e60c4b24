"""Measured light of the sun and the twilight that ships with the program."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib import resources

import numpy as np

from twilight.base.errors import TwilightError


@dataclass(frozen=True)
class Site:
    """Where zenith luminance was measured; ``evening``: midday UTC before a typical evening of the campaign."""

    name: str
    altitude_km: float
    latitude_deg: float
    longitude_deg: float
    evening: datetime
    transmission: tuple[float, float]


KOOMEN_SITES = (
    Site("Maryland", 0.03, 38.8, -77.0, datetime(1951, 2, 15, 17, tzinfo=UTC), (0.75, 0.85)),
    Site("Sacramento Peak", 2.8, 32.79, -105.82, datetime(1951, 6, 1, 19, tzinfo=UTC), (0.85, 0.90)),
)
"""Koomen et al. 1952; the middle of each campaign, and the stated range of the vertical photopic transmission."""

ILLUMINANCE_SOURCE = "Janiczek and DeYoung 1987"
LUMINANCE_SOURCE = "Koomen et al. 1952"


@lru_cache(maxsize=2)
def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("twilight").joinpath(f"data/references/{name}").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def horizontal_illuminance_lux(sun_elevation_deg) -> np.ndarray:
    """Illuminance of the ground by sun and clear sky [lx], Janiczek and DeYoung 1987, for -18 to 90 deg, any shape.

    Where two pieces meet the upper one holds.  Raises TwilightError outside the range.
    """
    h = np.asarray(sun_elevation_deg, dtype=float)
    pieces = [{k: float(v) for k, v in row.items()} for row in _rows("janiczek_deyoung1987.csv")]
    if not (np.all(h >= -18.0) and np.all(h <= 90.0)):
        raise TwilightError(f"{ILLUMINANCE_SOURCE}: sun elevation must be from -18 to 90 deg")
    out = np.full(h.shape, np.nan)
    for piece in reversed(pieces):  # from the lowest up
        x = h / 90.0
        log = piece["l0"] + x * (piece["l1"] + x * (piece["l2"] + x * piece["l3"]))
        out = np.where(h >= piece["altitude_min_deg"], log, out)
    return 10.0**out


def zenith_luminance_cd_m2(site: str) -> tuple[np.ndarray, np.ndarray]:
    """Sun elevations [deg] and measured zenith luminance [cd m^-2] of a site of Koomen et al. 1952."""
    rows = [row for row in _rows("koomen1952_zenith_luminance.csv") if row["site"] == site]
    if not rows:
        raise TwilightError(f"site: '{site}' is not known, choose from {', '.join(s.name for s in KOOMEN_SITES)}")
    return tuple(np.array([float(row[k]) for row in rows]) for k in ("sun_elevation_deg", "luminance_cd_m2"))  # type: ignore[return-value]
