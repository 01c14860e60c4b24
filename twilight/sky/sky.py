"""``Sky``: the radiance of the whole sky on a grid of directions, computed or measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.arguments import in_units, plain
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.comparison import SkyComparison
from twilight.sky.disc import Disc
from twilight.sky.moon import MoonSeen
from twilight.sky.polarised import PolarisedSky, nearest_known, read_table
from twilight.sky.quantities.sky_light import SkyLight
from twilight.sky.table import SkyTable

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class BrowserPage(Protocol):
    """A page that shows a sky or a field in a browser, and itself in a notebook."""

    def save(self, path: str | Path) -> Path:
        """Write the page as one HTML file that needs no network, whole or not at all."""


NOISY = ("standard_error", "polarisation", "polarisation_error")
"""Fields of a `Sky` that are NaN where a solver with noise gives no radiance."""


def _array(value: Any, name: str) -> np.ndarray:
    """An array of whatever library; one of numpy's may hold NaN, which a sky with noise has where nothing is known."""
    return value if type(value) is np.ndarray else np.asarray(plain(value, name))


@in_units
@dataclass(frozen=True, eq=False)
class Sky(SkyLight, PolarisedSky):
    """Radiance of the sky over directions and wavelengths, E x A x W.

    wavelength_nm (W,): increasing.
    elevation_deg (E,): row centres, increasing, within -90..90 (negative rows: seen from high up).
    azimuth_deg (A,): relative to the sun, clockwise, increasing in [0, 360), all round the circle.
    sun_normalised_radiance (E, A, W): L / F0 [sr^-1], finite, not negative; nan where the standard error is nan too.
    sun_elevation_deg: true (unrefracted) elevation of the disc's centre.
    sun_azimuth_deg: clockwise from north; None = not known, and pictures of the world then show the sun in the north
        (their centre).
    distance_au: Earth-sun distance [au].
    observer_altitude_km, latitude_deg, longitude_deg, time (with time zone): of the observer, where known.
    ground_albedo (W,): Lambertian albedo below the horizon.
    standard_error (E, A, W): of sun_normalised_radiance [sr^-1], or None; nan where too few paths of a solver found
        light to know how much there is, which pictures show as in the nearest known direction and sums do not know.
    polarisation (E, A, 2, W): the sun-normalised Stokes parameters Q and U [sr^-1] (signs: ``conventions``), or None.
    polarisation_error (E, A, 2, W): their standard error [sr^-1], or None.
    direct_irradiance (W,): of the sun's beam at the observer at normal incidence, divided by F0 (0 in shadow), or None.
    apparent_sun_elevation_deg: refracted elevation of the disc, or None = the true one.
    solar_spectrum: one of ``spectrum.solar_spectra()``.
    night_radiance (E, A, W): of the night sky behind and in the air (airglow, stars, zodiacal light, light pollution,
        moonlight scattered in the air), mean over each wavelength's bin [W m^-2 sr^-1 nm^-1], or None.  Not of the sun:
        it is no part of sun_normalised_radiance, and counts as unpolarised.
    lights: terms of night_radiance by name (moon, airglow, stars, zodiacal_light, light_pollution), where known;
        `sky["moon"]` is the sky of one light, `sky - "moon"` that of the others, "sun" among them.
    disc: of the sun, where it was asked for; a layer of its own, never part of a radiance here.
    moon: where it was asked for, with its beam and its disc, which are no part of a radiance here either.
    provenance: what made it (JSON values): configuration, version, hash, run_time_s, solver ...

    Radiance in W m^-2 sr^-1 nm^-1 is the sun-normalised radiance times ``solar_irradiance``, plus the night.
    Luminance, irradiance, colour and ``sample`` are those of the sum.
    """

    wavelength_nm: np.ndarray
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    sun_normalised_radiance: np.ndarray
    sun_elevation_deg: float
    sun_azimuth_deg: float | None = None
    distance_au: float = 1.0
    observer_altitude_km: float = 0.0
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    time: datetime | None = None
    ground_albedo: np.ndarray | None = None
    standard_error: np.ndarray | None = None
    direct_irradiance: np.ndarray | None = None
    apparent_sun_elevation_deg: float | None = None
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM
    night_radiance: np.ndarray | None = None
    polarisation: np.ndarray | None = None
    polarisation_error: np.ndarray | None = None
    disc: Disc | None = None
    moon: MoonSeen | None = None
    provenance: dict = field(default_factory=dict)
    lights: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        for key in ("wavelength_nm", "elevation_deg", "azimuth_deg"):
            object.__setattr__(self, key, np.atleast_1d(np.asarray(getattr(self, key), dtype=float)))
        radiance = _array(self.sun_normalised_radiance, "sun_normalised_radiance")
        if radiance.dtype != np.float32:
            radiance = radiance.astype(float, copy=False)
        object.__setattr__(self, "sun_normalised_radiance", radiance)
        wavelength, elevation, azimuth = self.wavelength_nm, self.elevation_deg, self.azimuth_deg
        shape = (elevation.size, azimuth.size, wavelength.size)
        if radiance.shape != shape or 0 in shape:
            raise TwilightError(f"sky: sun_normalised_radiance has shape {radiance.shape}, the grid has {shape}")
        unknown = np.isnan(radiance)
        if self.standard_error is not None and np.shape(self.standard_error) == shape:
            unknown &= np.isnan(self.standard_error)
        else:
            unknown[:] = False
        if not ((np.isfinite(radiance) & (radiance >= 0)) | unknown).all():
            raise TwilightError("sky: sun_normalised_radiance must be finite and not negative")
        if wavelength[0] <= 0 or np.any(np.diff(wavelength) <= 0):
            raise TwilightError("sky: wavelength_nm must be positive and increase")
        if np.any(np.diff(elevation) <= 0) or elevation[0] < -90 or elevation[-1] > 90:
            raise TwilightError("sky: elevation_deg must increase within -90 to 90")
        if azimuth[0] < 0.0 or azimuth[-1] >= 360.0 or np.any(np.diff(azimuth) <= 0.0):
            raise TwilightError("sky: azimuth_deg must increase within 0 to 360, 360 left out")
        widest = float(np.diff(np.append(azimuth, azimuth[0] + 360.0)).max())
        if azimuth.size > 2 and widest >= 180.0:
            raise TwilightError(f"sky: azimuth_deg must go all round; allowed is a gap below 180 deg, got {widest:g}")
        if self.lights:
            total = sum(self.lights.values())
            if self.night_radiance is None:
                object.__setattr__(self, "night_radiance", total)
            elif np.shape(total) != np.shape(self.night_radiance) or not np.allclose(
                total, self.night_radiance, 1e-6, 0
            ):
                raise TwilightError("sky: lights must add up to night_radiance; leave one of them out")
        stokes = (*shape[:2], 2, shape[2])
        for key, expected, lowest in (
            ("standard_error", shape, 0.0),
            ("direct_irradiance", shape[2:], 0.0),
            ("night_radiance", shape, 0.0),
            ("polarisation", stokes, -np.inf),
            ("polarisation_error", stokes, -np.inf),
        ):
            if (value := getattr(self, key)) is not None:
                value = _array(value, key)
                absent = (unknown if len(expected) == 3 else unknown[:, :, None]) if key in NOISY else False
                if value.shape != expected or not (np.isfinite(value) | absent).all() or (value < lowest).any():
                    sign = " and not be negative" if lowest == 0.0 else ""
                    raise TwilightError(f"sky: {key} must have shape {expected}, be finite{sign}")
                object.__setattr__(self, key, value)
        albedo = np.zeros(wavelength.size) if self.ground_albedo is None else plain(self.ground_albedo, "ground_albedo")
        albedo = np.broadcast_to(albedo, (wavelength.size,)).copy()
        if not ((albedo >= 0) & (albedo <= 1)).all():
            raise TwilightError("sky: ground_albedo must be between 0 and 1")
        object.__setattr__(self, "ground_albedo", albedo)
        if not self.distance_au > 0:
            raise TwilightError(f"sky: distance_au {self.distance_au} must be positive")
        spectrum.solar_spectrum(self.solar_spectrum)
        if self.disc is not None and not np.array_equal(self.disc.wavelength_nm, wavelength):
            raise TwilightError("sky: disc must have the wavelengths of the sky")

    def __repr__(self) -> str:
        """Five lines: the grid, the sun, and how bright it is."""
        w, e = self.wavelength_nm, self.elevation_deg
        when = "" if self.time is None else f", {self.time.isoformat()}"
        solver = self.provenance.get("solver")
        by_solver = f", by {solver} ({self.provenance.get('quality')})" if solver else ""
        v = f", {self.magnitude():.2f} V mag arcsec^-2" if self.covers("V") else ""
        return (
            f"<Sky: sun at {self.sun_elevation_deg:+.2f} deg{when}{by_solver}\n"
            f"  {e.size} elevations {e[0]:g} to {e[-1]:g} deg, {self.azimuth_deg.size} azimuths from the sun\n"
            f"  {w.size} wavelengths {w[0]:g} to {w[-1]:g} nm, radiance [W m^-2 sr^-1 nm^-1] in .radiance\n"
            f"  zenith {self.luminance_at(90.0):.4g} cd m^-2{v}\n"
            f"  illuminance by the sky {self.illuminance_lux():.4g} lx>"
        )

    if TYPE_CHECKING:  # what draws stands above this room: `twilight.api.representation` attaches these

        def plot(self, projection: str = "wide", ax: Axes | None = None, **options: Any) -> Figure: ...
        def view(self) -> BrowserPage: ...
        def to_xarray(self) -> xarray.Dataset: ...
        def _repr_html_(self) -> str: ...

    @overload
    def __sub__(self, other: Sky) -> SkyComparison[Sky]: ...
    @overload
    def __sub__(self, other: str) -> Sky: ...

    def __sub__(self, other: Sky | str) -> SkyComparison[Sky] | Sky:
        """Difference of the radiances of two skies with the same directions and wavelengths; or the sky without a light
        of this name."""
        if isinstance(other, str):
            self[other]  # which says what there is
            return self.only(*(name for name in ("sun", *self._others) if name != other))
        return SkyComparison(self, other, "difference") if isinstance(other, Sky) else NotImplemented

    def __truediv__(self, other: Sky) -> SkyComparison[Sky]:
        """Ratio of the radiances of two skies with the same directions and wavelengths."""
        return SkyComparison(self, other, "ratio") if isinstance(other, Sky) else NotImplemented

    @property
    def _others(self) -> Mapping[str, np.ndarray]:
        """Terms of night_radiance; of a sky that knows none of them, all of it as `night`."""
        return self.lights or ({} if self.night_radiance is None else {"night": self.night_radiance})

    def __getitem__(self, name: str) -> Sky:
        """The sky of one light, `sun` or a name of `lights`."""
        return self.only(name)

    def only(self, *names: str) -> Sky:
        """The sky of some of its lights alone, with their beams and discs.

        Errors: TwilightError for a light that it does not have.
        """
        others = self._others
        for name in names:
            if name != "sun" and name not in others:
                raise TwilightError(f"sky: has no light '{name}'; it has {', '.join(('sun', *others))}")
        chosen = {name: values for name, values in others.items() if name in names}
        changes: dict[str, Any] = {"lights": chosen, "night_radiance": None}
        if "moon" not in names:
            changes["moon"] = None
        if "sun" not in names:
            changes |= dict.fromkeys(("standard_error", "polarisation", "polarisation_error", "disc"))
            changes["sun_normalised_radiance"] = np.zeros_like(self.sun_normalised_radiance)
            if self.direct_irradiance is not None:
                changes["direct_irradiance"] = np.zeros_like(self.direct_irradiance)
        return replace(self, **changes)

    @property
    def elevation_edges_deg(self) -> np.ndarray:
        """Lower and upper edges of the rows [deg], (E + 1,): midpoints; the outer rows reach the zenith and the
        horizon (where rows lie below the horizon: half a row step further, at most to the nadir)."""
        e = self.elevation_deg
        middle = 0.5 * (e[1:] + e[:-1])
        bottom = 0.0 if e[0] >= 0 else max(-90.0, 2 * e[0] - middle[0] if middle.size else -90.0)
        return np.concatenate([[bottom], middle, [90.0]])

    @property
    def _azimuth_weights(self) -> np.ndarray:
        """Part of the circle that each column stands for [rad], (A,)."""
        a = np.radians(self.azimuth_deg)
        step = np.diff(np.append(a, a[0] + 2.0 * np.pi))
        return 0.5 * (step + np.roll(step, 1))

    def _elevation_weights(self, power: int, lowest_rad: float = 0.0) -> np.ndarray:
        """Integrals from an elevation up of cos sin^power times what each row counts for, (E,).

        Between rows light is a straight line, outside them as at the outermost.
        """
        e = np.radians(self.elevation_deg)
        edges = np.unique(np.concatenate([[lowest_rad], np.clip(e, lowest_rad, 0.5 * np.pi), [0.5 * np.pi]]))
        x, w = np.polynomial.legendre.leggauss(6)
        half = 0.5 * np.diff(edges)[:, None]
        at = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * x
        weight = (half * w * np.cos(at) * np.sin(at) ** power).ravel()
        k = np.clip(np.searchsorted(e, at.ravel(), side="right") - 1, 0, max(e.size - 2, 0))
        if e.size == 1:
            return np.array([weight.sum()])
        f = np.clip((at.ravel() - e[k]) / (e[k + 1] - e[k]), 0.0, 1.0)
        return np.bincount(k, (1.0 - f) * weight, e.size) + np.bincount(k + 1, f * weight, e.size)

    def solid_angle_sr(self) -> np.ndarray:
        """Solid angle that every sample stands for [sr], (E, A); of a hemisphere in all 2 pi, of a sphere 4 pi."""
        lowest = -0.5 * np.pi if self.elevation_deg[0] < 0.0 else 0.0
        return self._elevation_weights(0, lowest)[:, None] * self._azimuth_weights

    @property
    def solar_irradiance(self) -> np.ndarray:
        """Solar irradiance [W m^-2 nm^-1], (W,): bin means (``spectrum.solar_irradiance``) at the sky's distance."""
        return spectrum.solar_irradiance(self.wavelength_nm, self.solar_spectrum, self.distance_au)

    @property
    def radiance(self) -> np.ndarray:
        """Spectral radiance [W m^-2 sr^-1 nm^-1], (E, A, W), mean over each wavelength's bin of the solar spectrum."""
        radiance = self.sun_normalised_radiance * self.solar_irradiance
        return radiance if self.night_radiance is None else radiance + self.night_radiance

    @property
    def normalised_radiance(self) -> np.ndarray:
        """Radiance of sun and night together over F0 [sr^-1], (E, A, W): ``radiance`` over ``solar_irradiance``."""
        if self.night_radiance is None:
            return self.sun_normalised_radiance
        return self.sun_normalised_radiance + self.night_radiance / self.solar_irradiance

    def sample(self, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Radiance of sun and night together over F0, in any direction.

        The sun's part and the night are interpolated each for itself (`twilight.sky.table`), as `resample` does;
        `luminance_at` is the luminance of it.

        Parameters
        ----------
        elevation_deg
            Of the line of sight [deg], not below the sky's lower edge.
        azimuth_deg
            Relative to the sun, clockwise [deg]; broadcast with the elevation.

        Returns
        -------
        numpy.ndarray
            Sun-normalised radiance [sr^-1], shape of the directions plus (W,).

        Raises
        ------
        TwilightError
            For a direction below the sky's lower edge, and one that is not finite.
        """
        sun = self._sample(self.sun_normalised_radiance, elevation_deg, azimuth_deg)
        if self.night_radiance is None:
            return sun
        return sun + self._sample(self.night_radiance, elevation_deg, azimuth_deg) / self.solar_irradiance

    def _sample(self, values: np.ndarray, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Values (E, A, W) >= 0 of the grid in any direction."""
        elevation, azimuth = np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float)
        lower = self.elevation_edges_deg[0]
        beyond = elevation[~((elevation >= lower - ROUNDING) & (elevation <= 90.0 + ROUNDING))]
        if beyond.size:
            below = "; below is the ground, which observer.view shows" if beyond.min() < lower <= 0.0 else ""
            raise TwilightError(
                f"sample: elevation_deg is {beyond[0]:g}; allowed in this sky is {lower:g} to 90{below}"
            )
        found = self.smooth(values, elevation, azimuth)
        if np.isnan(values).any():
            found[self.smooth(np.isnan(values).astype(float), elevation, azimuth) > 0.5] = np.nan
        return found

    def resample(self, elevation_deg, azimuth_deg) -> Sky:
        """The sky on another grid (elevation_deg (E',), azimuth_deg (A',)), by ``sample``.

        A standard error is interpolated in the same way, as an upper bound (no averaging is assumed); the night too.
        """
        elevation = np.atleast_1d(np.asarray(elevation_deg, float))
        azimuth = np.atleast_1d(np.asarray(azimuth_deg, float))
        grid = np.meshgrid(elevation, azimuth, indexing="ij")
        layers = {
            name: None if values is None else self._sample(values, *grid)
            for name, values in (("standard_error", self.standard_error), ("night_radiance", self.night_radiance))
        }
        factor = self._sample(self.sun_normalised_radiance, *grid)
        lights = {name: self._sample(values, *grid) for name, values in self.lights.items()}
        night = layers["night_radiance"]
        if lights and night is not None:  # a logarithm of a sum is not that of its terms
            whole = np.sum(list(lights.values()), axis=0)
            scale = np.divide(night, whole, out=np.ones_like(factor, float), where=whole > 0.0)
            lights = {name: scale * values for name, values in lights.items()}
        polarisation = None
        if self.polarisation is not None:
            total = factor if night is None else factor + night / self.solar_irradiance
            polarisation = self.sample_fractional_stokes(*grid) * total[..., None, :]
        return replace(
            self,
            elevation_deg=elevation,
            azimuth_deg=azimuth,
            sun_normalised_radiance=factor,
            standard_error=layers["standard_error"],
            polarisation=polarisation,
            polarisation_error=None,
            night_radiance=night,
            lights=lights,
        )

    def smooth(self, values: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Values (E, A, K) >= 0 on this sky's grid in broadcast directions, (..., K), by the rule of `SkyTable`.

        Elevations (n, 1) with azimuths (1, m), the rows and columns of a picture, are fastest.  What is nan is taken as
        in the nearest known direction.
        """
        table = SkyTable.of_samples(self.elevation_deg, self.azimuth_deg, nearest_known(np.asarray(values)))
        return read_table(table, np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))

    def irradiance_factor(self, horizontal: bool = True, direct: bool = False) -> np.ndarray:
        """Irradiance from the upper hemisphere divided by F0, (W,); a uniform radiance of 1 gives pi exactly.

        ``horizontal``: on a horizontal plane, else on a sphere (fluence).  Between rows radiance is a straight line in
        elevation, the cosine and the solid angle are integrated exactly.  ``direct`` adds the sun's beam (TwilightError
        where the sky does not know it).
        """
        rows, columns = self._elevation_weights(1 if horizontal else 0), self._azimuth_weights
        result = np.einsum("e,a,eaw->w", rows, columns, self.normalised_radiance.astype(float), optimize=True)
        if direct:
            if self.direct_irradiance is None:
                raise TwilightError("irradiance: this sky does not know the sun's direct_irradiance")
            sun = self.sun_elevation_deg if self.apparent_sun_elevation_deg is None else self.apparent_sun_elevation_deg
            result = result + self.direct_irradiance * (max(0.0, np.sin(np.radians(sun))) if horizontal else 1.0)
        return result

    def irradiance(self, horizontal: bool = True, direct: bool = False) -> np.ndarray:
        """Spectral irradiance [W m^-2 nm^-1], (W,): ``irradiance_factor`` times ``solar_irradiance``."""
        return self.irradiance_factor(horizontal, direct) * self.solar_irradiance
