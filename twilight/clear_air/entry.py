"""The entry to the model: `skies`, of airs, observers, suns and directions at once; which of these the model has."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium, observer_at
from twilight.base.errors import TwilightError
from twilight.base.reading import reading
from twilight.base.threads import in_slices, one_blas_thread
from twilight.clear_air.diffuse import diffuse_light
from twilight.clear_air.model import SUN_DEG, Model
from twilight.clear_air.of_medium import LIMITED, air_of, limited, side_by_side
from twilight.clear_air.shells import STEP, Air, Shells
from twilight.clear_air.skies import Skies
from twilight.clear_air.sky import Sky
from twilight.jit.kernels import COMPILED

SHIPPED = Path(__file__).resolve().parents[1] / "data" / "compact" / "clear-air.npz"
"""The file of the model."""

HIGHEST_OBSERVER_KM = 15.0
"""Highest observer above the ground."""

WAVELENGTH_NM = (320.0, 1000.0)
"""Wavelengths of the airs that were fitted."""

RELATIVE_SLACK = 0.05
"""How far beyond the fitted airs an air may be, relative to the largest of them."""

LEAST_SLACK = 1e-7
"""How far beyond the fitted airs an air may be in any case."""

TOP_KM = (95.0, 100.5)
"""Thickness of the air of a medium [km]: that of the fitted airs is 100; with 95 light at -14 deg is 1.3 % off."""

RADIUS_KM = (6345.0, 6396.0)
"""Radii of the Earth [km]: light scattered more than once is that of 6371; 25 km more or less move it by 2 % at -14."""

MOST_DEPOLARISATION = 0.1
"""Largest depolarisation factor of air, 0.03 in the fitted ones; with 0.1 light is 0.8 % off, with 0.5 3.6 %."""

MOST_BY_NUMPY = 16
"""Most wavelengths of a process whose diffuse light numpy computes, those of a sky with its screen: some 20 processor
ms each, where kernels take 7 and numba starts in 300."""

_asked: list[int] = []
"""Numbers of wavelengths whose diffuse light was asked for before numba was loaded."""

CACHED_SKIES = 8
"""Observers whose skies are cached, before a screen and behind it."""


@functools.lru_cache(maxsize=1)
def shipped_model() -> Model:
    """The model that twilight has."""
    return load_model(SHIPPED)


def load_model(path: Path) -> Model:
    """Read a file of the model; TwilightError for one that is none."""
    with reading(path, "a model of clear air"):
        return Model.load(path)


class SkyArrays(NamedTuple):
    """The light of N airs, O observers and S suns: radiance over F0 [sr^-1], (N, O, S, ..., W), or I, Q, U where they
    are asked for, (N, O, S, ..., 3, W), and its error at 95 % of the directions of each sky, as the model estimates it,
    (N, O, S)."""

    radiance: np.ndarray
    relative_error: np.ndarray


class ClearAir:
    """The air of a medium that the model has, with what was computed for its observers.

    Errors: TwilightError for a medium unlike the clear air that the model was fitted to, in one sentence.
    """

    def __init__(self, medium: Medium, model: Model | None = None):
        self.medium, self.model = medium, model or shipped_model()
        check_medium(medium)
        self.air = air_of(medium)
        check_air(self.air, medium.wavelength_nm, self.model)
        self.filtered = np.exp(-medium.overhead_absorption_optical_depth)
        self.screen = medium.screen
        if self.screen is not None:
            above = tuple(z - medium.bottom_km for z in self.screen.altitude_km)
            self.screen = replace(self.screen, altitude_km=above)
        self._skies: dict[tuple[float, bool], Skies] = {}
        self._last: tuple[Skies, float, Sky] | None = None

    def sky(self, sun_elevation_deg: float, altitude_km: float) -> Sky:
        """The sky of a sun and an observer, before what filters its light."""
        above, sun = checked_observer(self.medium, altitude_km) - self.medium.bottom_km, float(sun_elevation_deg)
        skies = self._seen_from(above)
        if self.screen is not None and sun < skies.lowest_spared_deg(self.screen):
            skies = self._seen_from(above, screened=True)
        last = self._last  # a sky is often asked for in pieces
        sky = last[2] if last is not None and last[0] is skies and last[1] == sun else skies.sky(sun)
        self._last = skies, sun, sky
        return sky

    def slopes(
        self, directions: Sequence[Air], sun_elevation_deg: float, elevation_deg, azimuth_deg, altitude_km: float
    ) -> np.ndarray:
        """Derivatives of I, Q, U [sr^-1 per unit of each parameter] along changes of the air (`of_medium.slope`), exact
        but for rounding in single precision: (D, *directions of the sky, 3, W).

        Forward mode along the batch: D airs are solved side by side in complex numbers, some 4 D airs' time.  The
        refractive index and the observer do not change.  Errors: as of `skies`.
        """
        elevation, azimuth = checked_directions(sun_elevation_deg, elevation_deg, azimuth_deg)
        airs = side_by_side([self.air.towards(direction) for direction in directions])
        above, sun = checked_observer(self.medium, altitude_km) - self.medium.bottom_km, float(sun_elevation_deg)
        skies = Skies(self.model, airs, above)
        if self.screen is not None and sun < skies.lowest_spared_deg(self.screen):
            skies = skies.behind(self.screen, np.tile(self.screen.powers(self.medium.wavelength_nm), len(directions)))
        light = skies.sky(sun).light(elevation.ravel(), azimuth.ravel(), 3, on_grid=False).imag / STEP
        light = light.reshape(*elevation.shape, 3, len(directions), -1) * self.filtered
        return np.moveaxis(light, -2, 0)

    def _seen_from(self, above: float, screened: bool = False) -> Skies:
        """The skies of an observer above the ground [km], computed when one is asked for first."""
        if (above, screened) not in self._skies:
            made = Skies(self.model, self.air, above, diffuse_of) if not screened else self._seen_from(above)
            if screened and self.screen is not None:
                made = made.behind(self.screen, self.screen.powers(self.medium.wavelength_nm))
            if len(self._skies) == CACHED_SKIES:
                del self._skies[next(iter(self._skies))]
            self._skies[above, screened] = made
        return self._skies[above, screened]


@one_blas_thread()
def skies(
    airs: Sequence[Medium | ClearAir],
    sun_elevation_deg: Sequence[float],
    elevation_deg,
    azimuth_deg,
    altitude_km: Sequence[float | None] = (None,),
    polarisation: bool = False,
) -> SkyArrays:
    """The skies of airs of as many wavelengths under suns [deg], in directions of one shape [deg, azimuth from the
    sun], for observers above sea level [km]; None: on the ground of each.

    Of a medium nothing is kept; a `ClearAir` keeps what it computed.  Each is a thread's (`in_slices`).
    Errors: TwilightError for an air, a sun, a direction or an observer that the model does not have: -18 to 90 deg, 0
    to 90 deg, up to 15 km above the ground; before any sky is computed.
    """
    for sun in sun_elevation_deg:
        elevation, azimuth = checked_directions(sun, elevation_deg, azimuth_deg)
    each = [one if isinstance(one, ClearAir) else ClearAir(one) for one in airs]
    observers = [[checked_observer(one.medium, altitude) for altitude in altitude_km] for one in each]
    grid = rows_and_columns(elevation, azimuth)
    shape = (*elevation.shape, *((3,) if polarisation else ()), each[0].air.degree.size)
    light = np.empty((len(each), len(altitude_km), len(sun_elevation_deg), *shape))
    error = np.empty(light.shape[:3])

    def work(first: int, end: int) -> None:
        for n in range(first, end):
            one, each[n] = each[n], None  # type: ignore[call-overload]
            for o, altitude in enumerate(observers[n]):
                for s, sun in enumerate(sun_elevation_deg):
                    sky = one.sky(sun, altitude)
                    error[n, o, s] = sky.relative_error
                    directions = grid or (elevation.ravel(), azimuth.ravel())
                    found = sky.light(*directions, 3 if polarisation else 1, grid is not None)
                    light[n, o, s] = (found * one.filtered).reshape(shape)

    in_slices(work, len(each))
    return SkyArrays(light, error)


def diffuse_of(air: Air, shells: Shells) -> np.ndarray:
    """`diffuse_light`; compiled, and the same but for rounding, once a process has loaded numba or asks for more
    wavelengths than it should not be loaded for."""
    by_numpy = not COMPILED
    if COMPILED and "numba" not in sys.modules:
        _asked.append(air.degree.size)
        by_numpy = sum(_asked) <= MOST_BY_NUMPY
    if by_numpy:
        return diffuse_light(air, shells)
    from twilight.clear_air import lanes  # start-up

    return lanes.diffuse_light(air, shells)


def check_air(air: Air, wavelength_nm: np.ndarray, model: Model) -> None:
    """TwilightError for an air that differs from those that were fitted, which says in what."""
    for what, values, (low, high) in zip(LIMITED, limited(air), model.limits.astype(float), strict=True):
        slack = RELATIVE_SLACK * high + LEAST_SLACK
        wrong = (values < low - slack) | (values > high + slack)
        if wrong.any():
            w = int(np.argmax(wrong))
            raise TwilightError(
                f"the compact model of clear air is made of airs in which {what} is {max(low, 0.0):.3g} to {high:.3g}, "
                f"and here it is {values[w]:.3g} at {wavelength_nm[w]:g} nm; take --solver zones"
            )


def checked_observer(medium: Medium, altitude_km: float | None) -> float:
    """The altitude of an observer [km], None: on the ground; TwilightError for one that the model lacks."""
    altitude = observer_at(medium, altitude_km, medium.bottom_km)
    high = medium.bottom_km + HIGHEST_OBSERVER_KM
    if altitude > high:
        raise TwilightError(
            f"the compact solver knows the sky of observers up to {HIGHEST_OBSERVER_KM:g} km above the ground: "
            f"observer.altitude_km is {altitude:g}, allowed is {medium.bottom_km:g} to {high:g}"
        )
    return altitude


def check_medium(medium: Medium) -> None:
    """TwilightError for what the airs of the fit never had: wavelengths, clouds, another Earth, air that ends below or
    above theirs."""
    (low_nm, high_nm), (low_km, high_km), (least, most) = WAVELENGTH_NM, TOP_KM, RADIUS_KM
    thick, rho = medium.top_km - medium.bottom_km, float(medium.depolarisation.max())
    outside = [nm for nm in medium.wavelength_nm if not low_nm <= nm <= high_nm]
    clouds = [name for name, _, _ in medium.notes.get("regions", ()) if name == "fog" or name.endswith(" cloud")]
    for wrong, is_made_of in (
        (clouds, f"air without clouds, and this has {[*clouds, ''][0]}"),
        (outside, f"wavelengths from {low_nm:g} to {high_nm:g} nm, and {[*outside, 0.0][0]:g} nm is asked for"),
        (
            not low_km <= thick <= high_km,
            f"air of {low_km:g} to {high_km:g} km, and this has {thick:g}",
        ),
        (not least <= medium.earth_radius_km <= most, f"the Earth, not of a radius of {medium.earth_radius_km:g} km"),
        (rho > MOST_DEPOLARISATION, f"depolarisation up to {MOST_DEPOLARISATION:g}, and this air has {rho:g}"),
    ):
        if wrong:
            raise TwilightError(f"the compact model of clear air is made of {is_made_of}; take --solver zones")


def checked_directions(sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths of one shape [deg]; TwilightError below the horizon, and for a sun beyond the model's."""
    low, high = SUN_DEG[[0, -1]]
    if not low <= sun_elevation_deg <= high:
        raise TwilightError(
            f"sun.elevation_deg is {sun_elevation_deg:g}; the compact solver allows {low:g} to {high:g}"
        )
    elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
    if elevation.size and not (elevation.min() >= 0.0 and elevation.max() <= 90.0):
        raise TwilightError("the compact solver knows the sky above the horizon only: elevations from 0 to 90 deg")
    return elevation, azimuth


def rows_and_columns(elevation: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Elevations (E,) of the rows and azimuths (A,) of the columns of directions (E, A) that are a grid; None: they are
    not."""
    if elevation.ndim != 2 or not elevation.size:
        return None
    rows, columns = elevation[:, :1], azimuth[:1]
    return (rows[:, 0], columns[0]) if (elevation == rows).all() and (azimuth == columns).all() else None
