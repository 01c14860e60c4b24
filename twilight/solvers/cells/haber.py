"""Haber section 3, the system in five steps, of which the last four are here:

    2  layers of air (4.1.2) and cells around the observer (4.1.3): `grid`
    3  direct light (4.6.2) along refracted paths (4.4): `direct_light`
    4  indirect light: passes between all pairs of cells (`exchange`, 4.5.3 to 4.6.2 and 5), of active shells (5), and
       with the ground (`ground`, 4.1.4)
    5  the sky texture (`sky_texture`, 4.7)

Air scatters isotropically from the first event on (4.5.1), aerosol from the second on.  Its scattering coefficient is
then less by g, eq. (2): in the third event and all that follow, for section 4.6.2 makes I_2 by eq. (5) as it is printed
and takes (1 - g) "for the next and all higher-order scattering events".  Section 4.5.3 can be read as if the second did
so too.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.progress import Progress, silent
from twilight.base.sections import option, settings
from twilight.solvers.base import BareField, Convergence, Cost, check_sun
from twilight.solvers.cells.direct_light import sunlit
from twilight.solvers.cells.exchange import energy_ratio, exchange, full_turn, make_active_shells, make_rings
from twilight.solvers.cells.grid import CellGrid, Layers, make_grid, make_layers
from twilight.solvers.cells.ground import Patches, exchange_with_ground, make_patches, sunlit_ground
from twilight.solvers.cells.sky_texture import SkyTexture


@settings
class CellsSettings:
    """What a user can set of Haber's cells."""

    max_orders: int = option("scattering events that are followed", default=5, ge=1, le=100)
    refraction: bool = option("bend the sunbeam", default=True)
    azimuth_cells: int = option(
        "S, the number of cells around a ring; their angular size is 360/S deg in azimuth and elevation",
        default=92,
        ge=8,
        le=360,
    )
    active_shell_step: int = option("every n-th shell takes part in multiple scattering", default=4, ge=1, le=16)
    inner_radius_km: float = option("R_min, radius of the innermost shell", default=0.1, ge=0.001, le=10.0, expert=True)
    sun_tolerance_deg: float = option(
        "of the binary search for the refracted path to the sun", default=0.1, ge=1e-4, le=0.5, expert=True
    )
    effective_from_event: int = option(
        "scattering event from which on the aerosol scatters (1 - g) of its coefficient: 3 as in the passes of section "
        "4.6.2, 2 as section 4.5.3 can be read",
        default=3,
        ge=2,
        le=3,
        expert=True,
    )
    reduce_extinction: bool = option(
        "in these events take g of the aerosol's scattering from its extinction too, so that no light is lost; Haber "
        "takes it from scattering alone",
        default=False,
        expert=True,
    )
    tolerance: float = option(
        "stop earlier when an event adds less than this fraction of the light of every cell; 0 follows max_orders",
        default=0.0,
        ge=0.0,
        le=0.5,
        expert=True,
    )

    def __post_init__(self):
        if self.azimuth_cells % 2:
            raise TwilightError(f"solver.azimuth_cells is {self.azimuth_cells}; it must be even")


QUALITIES: dict[str, CellsSettings] = {
    "draft": CellsSettings(azimuth_cells=66),
    "standard": CellsSettings(),
    "haber2005": CellsSettings(azimuth_cells=120),
}
"""Sizes with cells in every shell of air up to 35, 60 and 100 km: the cells of 66, 92 and 120 have 1.35, 1.04 and 1.02
times the volume of Haber's air, and 0.96, 1.01 and 0.96 times that of air up to 100 km."""

RINGS_AT_ONCE = 256
"""Rings whose light of an event is there at the same time, beside the sum of all events."""


class CellsField(BareField):
    """Haber's sky of one medium around one observer; the latest sun's is kept."""

    def __init__(
        self,
        medium: Medium,
        settings: CellsSettings,
        observer_altitude_km: float,
        progress: Progress | None = None,
        grid: CellGrid | None = None,
    ):
        if not settings.refraction:
            medium = replace(medium, refractivity=np.zeros_like(medium.refractivity))
        self.medium, self.settings = medium, settings
        self._progress = progress or silent
        self.tolerance = math.radians(settings.sun_tolerance_deg) if medium.has_refraction else 0.0
        self.layers = make_layers(medium, settings.reduce_extinction)
        self.grid = grid_of(medium, settings, observer_altitude_km) if grid is None else grid
        self.rings = make_rings(self.grid, self.layers, np.arange(self.grid.n_rings))
        self.active = make_active_shells(self.grid, settings.active_shell_step)
        self.active_rings = make_rings(self.grid, self.layers, self.active.ring)
        self.patches: Patches | None = None
        if np.any(medium.ground_albedo > 0.0):
            self.patches = make_patches(self.grid, np.unique(self.grid.ring_shell[self.active.ring]), medium.bottom_km)
        self.texture = SkyTexture(self.grid, self.layers, self.rings)
        self._solved: tuple[float, np.ndarray] | None = None

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """As `Field.radiance` of :mod:`twilight.solvers.base`; below the horizon the air in front of the ground."""
        check_sun(sun_elevation_deg)
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        if self._solved is None or self._solved[0] != sun_elevation_deg:
            h = math.radians(sun_elevation_deg)
            sun = np.array([math.cos(h), 0.0, math.sin(h)])
            *_, (isotropic, aerosol) = self.events(sun)
            self._solved = (sun_elevation_deg, self.texture.radiance(isotropic, aerosol, sun))
        found = self.texture.interpolate(self._solved[1], elevation.ravel(), azimuth.ravel())
        self._progress("sky", 1.0)
        return found.reshape(*elevation.shape, -1)

    def events(self, sun: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """After each scattering event I_isotropic and I_aerosol (G, W, H) over F0 [km^2] of all so far, the same arrays
        each time; aerosol's first event is apart.  sun (3,): unit vector to it."""
        s, rings = self.settings, self.rings
        self._progress("direct light", 0.0)
        filtered = np.exp(-self.medium.overhead_absorption_optical_depth)
        isotropic, aerosol = self.first_event(sun, filtered)
        self.convergence = Convergence(1, 1.0)
        yield isotropic, aerosol
        active = self.active.ring
        cells = full_turn(s.azimuth_cells)
        reflected = self.first_of_ground(sun, filtered)
        energy = isotropic @ cells + aerosol @ cells
        sent = isotropic[active]
        forward: np.ndarray | None = aerosol[active]
        fraction, event = 1.0, 1
        while event < s.max_orders and (event == 1 or fraction >= s.tolerance):
            event += 1
            layers = self.layers_of(event)
            amount = layers.later_scattering[rings.layer] * rings.volume[:, None]
            ratio = energy_ratio(energy, self.active)
            mean = self.one_pass(layers, sent, forward, sun)
            mean *= ratio[:, None]
            reflected = self._through_ground(layers, sent, forward, ratio, reflected, mean)
            # what an active cell scatters of what it extinguishes, over sigma_s V
            extinguished = (layers.later_extinction[rings.layer] * rings.volume[:, None])[active]
            mean *= np.divide(1.0, extinguished, out=np.zeros_like(extinguished), where=amount[active] > 0.0)[..., None]
            sent, forward = mean * amount[active][:, :, None], None
            fraction = 0.0
            for first in range(0, energy.shape[0], RINGS_AT_ONCE):
                some = slice(first, first + RINGS_AT_ONCE)
                more = self.active.spread(mean, some) * amount[some, :, None]
                isotropic[some] += more
                energy[some] = more @ cells
                lit = isotropic[some] > 0.0
                fraction = max(fraction, float(np.max(more[lit] / isotropic[some][lit], initial=0.0)))
            self._progress(f"scattering event {event}", 0.95 * event / s.max_orders)
            self.convergence = Convergence(event, fraction)
            yield isotropic, aerosol

    def layers_of(self, event: int) -> Layers:
        """The layers with the coefficients of a scattering event: eq. (2) counts from `effective_from_event` on."""
        if event >= self.settings.effective_from_event:
            return self.layers
        whole = self.layers.air + self.layers.aerosol
        return self.layers._replace(later_scattering=whole, later_extinction=self.layers.extinction)

    def first_event(self, sun: np.ndarray, filtered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """I_air and I_aerosol of direct light, as of `sunlit`; filtered (W,): transmittance of the ozone filter."""
        return sunlit(self.layers, self.rings, sun, self.tolerance, filtered)

    def one_pass(self, layers: Layers, sent: np.ndarray, forward: np.ndarray | None, sun: np.ndarray) -> np.ndarray:
        """What active cells extinguish of what they send, as of `exchange`."""
        return exchange(layers, self.active_rings, sent, forward, sun)

    def first_of_ground(self, sun: np.ndarray, filtered: np.ndarray) -> np.ndarray | None:
        """Sunlight that patches of the ground reflect, (N, W, H); None on dark ground."""
        if self.patches is None:
            return None
        light = np.empty((self.patches.area.size, filtered.size, self.settings.azimuth_cells // 2 + 1))
        sunlit_ground(self.layers, self.patches, sun, self.tolerance, light)
        return light * (filtered * self.medium.ground_albedo)[:, None]

    def _through_ground(self, layers, sent, forward, ratio, reflected, received) -> np.ndarray | None:
        """Add the ground's light to what active cells receive; what it reflects in the next event."""
        if self.patches is None or reflected is None:
            return None
        light = np.zeros_like(reflected)
        all_sent = sent if forward is None else sent + forward
        exchange_with_ground(layers, self.active_rings, self.patches, all_sent, reflected, received, light)
        return light * (ratio * self.medium.ground_albedo)[:, None]


def grid_of(medium: Medium, settings: CellsSettings, observer_altitude_km: float) -> CellGrid:
    """The cells that settings ask for in a medium."""
    air = medium.bottom_km, medium.top_km, medium.earth_radius_km
    return make_grid(settings.azimuth_cells, settings.inner_radius_km, observer_altitude_km, *air)


def _warn_of_gaps(field: CellsField) -> None:
    """Say that shells hold air and no cell, and which qualities have none such."""
    gaps, altitude_km = field.grid.shells_without_cells, field.grid.observer_altitude_km
    if not gaps.size:
        return
    grids = {name: grid_of(field.medium, settings, altitude_km) for name, settings in QUALITIES.items()}
    filled = [f"{name} ({one.azimuth_cells})" for name, one in grids.items() if not one.shells_without_cells.size]
    s, first_km = field.settings.azimuth_cells, field.grid.shell_radius_km[gaps[0]]
    warnings.warn(
        f"solver.azimuth_cells {s}: {gaps.size} of {field.grid.n_shells} shells around the observer hold air and the "
        f"centre of no cell, the first {first_km:.0f} km away, and their light is missing"
        f"{'; qualities without such: ' + ', '.join(filled) if filled else ''}",
        TwilightWarning,
        stacklevel=3,
    )


PAIR_S = 5.5e-7
"""Processor seconds of a pair of cells in a pass, there and back, whatever its wavelengths (S = 48 to 120)."""
PAIR_WAVELENGTH_S = 1.15e-7
"""The same of each wavelength of the pair."""
FORWARD_S = 2.7e-7
"""The same of each wavelength more in the pass whose light goes out by Henyey and Greenstein's function."""
SUNLIT_S = 2.5e-6
"""Processor seconds of a cell and wavelength in direct light: the search for the sun."""
POWERS_AT_ONCE = 2, 5
"""Numbers of a cell and wavelength that are there at the same time: of every cell, and more of an active one."""
WAVELENGTHS_OF_A_PASS = 32
"""Most wavelengths that share the geometry of a pass: those of a block."""


def cost(
    medium: Medium, settings: CellsSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost | None:
    """Cost of a field: all of it is for each sun."""
    grid = grid_of(medium, settings, observer_altitude_km)
    active = make_active_shells(grid, settings.active_shell_step).ring.size
    half, sharing = settings.azimuth_cells // 2 + 1, min(medium.n_wavelengths, WAVELENGTHS_OF_A_PASS)
    pairs = half * active * (active + 1) / 2
    passes = settings.max_orders - 1
    seconds = SUNLIT_S * grid.n_rings * half + passes * pairs * (PAIR_S / sharing + PAIR_WAVELENGTH_S)
    every, of_active = POWERS_AT_ONCE
    return Cost(
        fixed_bytes=0.0,
        bytes_per_wavelength=8.0 * half * (every * grid.n_rings + of_active * active),
        cpu_s_per_wavelength=0.0,
        cpu_s_per_direction=0.0,
        cpu_s_per_sun=seconds + min(passes, 1) * pairs * FORWARD_S,
    )


def prepare(
    medium: Medium,
    settings: CellsSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> CellsField:
    """Make everything that does not depend on the sun, as of `solvers.base.Solver`.

    Errors: TwilightError for an observer below the ground or above the air.  Warns where the air passes through shells
    that have no cell.  Haber, Magnor & Seidel 2005, Physically-based simulation of twilight phenomena."""
    settings = settings or QUALITIES["standard"]
    if not medium.bottom_km <= observer_altitude_km < medium.top_km:
        raise TwilightError(
            "the cells solver needs an observer inside the air: observer.altitude_km is "
            f"{observer_altitude_km:g}, allowed is {medium.bottom_km:g} to below {medium.top_km:g}"
        )
    field = CellsField(medium, settings, float(observer_altitude_km), progress)
    _warn_of_gaps(field)
    return field
