"""The solver compact: its settings, `prepare`, the interface of all solvers, and its field."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.reading import reading
from twilight.base.sections import option, settings
from twilight.jit.kernels import COMPILED
from twilight.solvers.base import BareField, Cost, ModelError, observer_at
from twilight.solvers.compact.air import LIMITED, air_of, limited, side_by_side
from twilight.transport.clear_air import Air, Model, Skies
from twilight.transport.clear_air.diffuse import diffuse_light
from twilight.transport.clear_air.model import SUN_DEG
from twilight.transport.clear_air.shells import STEP, Shells
from twilight.transport.clear_air.sky import Sky

SHIPPED = Path(__file__).resolve().parents[2] / "data" / "compact" / "clear-air.npz"
"""The file of the model."""

HIGHEST_OBSERVER_KM = 15.0
"""Highest observer above the ground."""

WAVELENGTH_NM = (320.0, 1000.0)
"""Wavelengths of the airs that were fitted."""

RELATIVE_SLACK = 0.05
"""How far beyond the fitted airs an air may be, relative to the largest of them."""

ROUNDING = 1e-7
"""How far beyond the fitted airs an air may be in any case."""

TOP_KM = (95.0, 100.5)
"""Thickness of the air of a medium [km]: that of the fitted airs is 100; with 95 light at -14 deg is 1.3 % off."""

RADIUS_KM = (6345.0, 6396.0)
"""Radii of the Earth [km]: light scattered more than once is that of 6371; 25 km more or less move it by 2 % at -14."""

MOST_DEPOLARISATION = 0.1
"""Largest depolarisation factor of air, 0.03 in the fitted ones; with 0.1 light is 0.8 % off, with 0.5 3.6 %."""

MOST_BY_NUMPY = 8
"""Most wavelengths of an air whose diffuse light numpy computes: some 20 processor ms each, where kernels take 7 and
numba starts in 300."""

CACHED_SKIES = 8
"""Observers whose skies are cached, before a screen and behind it."""


@settings
class CompactSettings:
    """What is computed beside the radiance."""

    polarisation: bool = option("the Stokes parameters Q and U too", default=True)


QUALITIES: dict[str, CompactSettings] = {"standard": CompactSettings()}


COST = Cost(fixed_bytes=1.75e8, bytes_per_wavelength=4.3e6, cpu_s_per_wavelength=0.022, cpu_s_per_direction=2.5e-5)
"""Of a field: the process takes 165 MiB with one wavelength, 325 with forty, and eight of a new air 0.17 processor
seconds; a direction and wavelength 25 microseconds in a sky of some hundred, which compute the sunbeam anew."""


@functools.lru_cache(maxsize=1)
def shipped_model() -> Model:
    """The model that twilight has."""
    return load_model(SHIPPED)


def load_model(path: Path) -> Model:
    """Read a file of the model; TwilightError for one that is none."""
    with reading(path, "a model of clear air"):
        return Model.load(path)


def prepare(
    medium: Medium,
    settings: CompactSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> ClearAirField:
    """The skies of a medium.  Errors: TwilightError for an observer, air or wavelengths that the model lacks."""
    polarisation = (settings or QUALITIES["standard"]).polarisation
    return ClearAirField(medium, shipped_model(), observer_altitude_km, polarisation)


def expected_error(
    medium: Medium, settings: CompactSettings, lowest_sun_deg: float, observer_altitude_km: float
) -> float:
    """What the model says of its error [fraction, 95 % of directions] under a sun, -inf: its lowest.

    Errors: TwilightError as of `prepare`, and for a sun below -18 deg.
    """
    sun = float(SUN_DEG[0]) if np.isneginf(lowest_sun_deg) else lowest_sun_deg
    field = ClearAirField(medium, shipped_model(), observer_altitude_km, settings.polarisation)
    field.radiance(sun, 90.0, 0.0)
    assert isinstance(field.convergence, ModelError)
    return field.convergence.error


class ClearAirField(BareField):
    """The skies of one medium for any sun from -18 to 90 deg and observers up to 15 km above the ground.

    convergence: its error is what the model says of the sky that was asked for last.
    Errors: TwilightError for a medium unlike the clear air that the model was fitted to, in one sentence.
    """

    def __init__(self, medium: Medium, model: Model, observer_altitude_km: float, polarisation: bool):
        self.medium, self.model = medium, model
        self._polarised = polarisation
        self._altitude_km = checked_observer(medium, observer_altitude_km)
        check_medium(medium)
        self.air = air_of(medium)
        check_air(self.air, medium.wavelength_nm, model)
        self._filtered = np.exp(-medium.overhead_absorption_optical_depth)
        self.screen = medium.screen
        if self.screen is not None:
            above = tuple(z - medium.bottom_km for z in self.screen.altitude_km)
            self.screen = replace(self.screen, altitude_km=above)
        self._skies: dict[tuple[float, bool], Skies] = {}
        self._last: tuple[Skies, float, Sky] | None = None
        self._seen_from(self.observer_above_km(None))

    @property
    def polarised(self) -> bool:
        """Whether Q and U were asked for."""
        return self._polarised

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun elevation of the model [deg]."""
        return float(SUN_DEG[0]), float(SUN_DEG[-1])

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Errors: TwilightError for a sun, a direction or an observer that the model does not have: -18 to 90 deg, 0 to
        90 deg, up to 15 km above the ground.
        """
        return self._light(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 1)[..., 0, :]

    def stokes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], shape of the directions plus (3, W); signs and errors as of
        `twilight.base.conventions` and `radiance`."""
        if not self._polarised:
            raise TwilightError("solver.polarisation is false: this field has no Stokes parameters")
        return self._light(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 3)

    def _light(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, altitude_km, n_stokes: int) -> np.ndarray:
        elevation, azimuth = checked_directions(sun_elevation_deg, elevation_deg, azimuth_deg)
        above, sun = self.observer_above_km(altitude_km), float(sun_elevation_deg)
        skies = self._seen_from(above)
        if self.screen is not None and sun < skies.lowest_spared_deg(self.screen):
            skies = self._seen_from(above, screened=True)
        last = self._last  # a sky is often asked for in pieces
        sky = last[2] if last is not None and last[0] is skies and last[1] == sun else skies.sky(sun)
        self._last = skies, sun, sky
        self.convergence = ModelError(sky.relative_error)
        grid = rows_and_columns(elevation, azimuth)
        if grid is not None:
            return sky.light(*grid, n_stokes) * self._filtered
        out = sky.light(elevation.ravel(), azimuth.ravel(), n_stokes, on_grid=False) * self._filtered
        return out.reshape(*elevation.shape, *out.shape[1:])

    def slopes(
        self,
        directions: Sequence[Air],
        sun_elevation_deg: float,
        elevation_deg,
        azimuth_deg,
        *,
        observer_altitude_km: float | None = None,
    ) -> np.ndarray:
        """Derivatives of I, Q, U [sr^-1 per unit of each parameter] along changes of the air (`air.slope`), exact but
        for rounding in single precision: (D, *directions of the sky, 3, W).

        Forward mode along the batch: D airs are solved side by side in complex numbers, some 4 D airs' time.  The
        refractive index and the observer do not change.  Errors: as of `radiance`.
        """
        elevation, azimuth = checked_directions(sun_elevation_deg, elevation_deg, azimuth_deg)
        airs = side_by_side([self.air.towards(direction) for direction in directions])
        skies, sun = Skies(self.model, airs, self.observer_above_km(observer_altitude_km)), float(sun_elevation_deg)
        if self.screen is not None and sun < skies.lowest_spared_deg(self.screen):
            skies = skies.behind(self.screen, np.tile(self.screen.powers(self.medium.wavelength_nm), len(directions)))
        sky = skies.sky(sun)
        light = sky.light(elevation.ravel(), azimuth.ravel(), 3, on_grid=False).imag / STEP
        light = light.reshape(*elevation.shape, 3, len(directions), -1) * self._filtered
        return np.moveaxis(light, -2, 0)

    def observer_above_km(self, altitude_km: float | None) -> float:
        """Altitude of an observer above the ground [km]; None: as prepared."""
        altitude = self._altitude_km if altitude_km is None else altitude_km
        return checked_observer(self.medium, altitude) - self.medium.bottom_km

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


def diffuse_of(air: Air, shells: Shells) -> np.ndarray:
    """`diffuse_light`; compiled, and the same but for rounding, of more wavelengths than a process should load numba
    for."""
    if not COMPILED or air.degree.size <= MOST_BY_NUMPY:
        return diffuse_light(air, shells)
    from twilight.solvers.compact import lanes  # start-up

    return lanes.diffuse_light(air, shells)


def check_air(air: Air, wavelength_nm: np.ndarray, model: Model) -> None:
    """TwilightError for an air that differs from those that were fitted, which says in what."""
    for what, values, (low, high) in zip(LIMITED, limited(air), model.limits.astype(float), strict=True):
        slack = RELATIVE_SLACK * high + ROUNDING
        wrong = (values < low - slack) | (values > high + slack)
        if wrong.any():
            w = int(np.argmax(wrong))
            raise TwilightError(
                f"the compact model of clear air is made of airs in which {what} is {max(low, 0.0):.3g} to {high:.3g}, "
                f"and here it is {values[w]:.3g} at {wavelength_nm[w]:g} nm; take --solver zones"
            )


def checked_observer(medium: Medium, altitude_km: float) -> float:
    """The altitude of an observer [km]; TwilightError for one that the model lacks."""
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
