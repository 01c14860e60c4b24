"""From solved fields, or one computed sky, to a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twilight import __version__
from twilight.engine import Problem, Solved
from twilight.errors import TwilightError
from twilight.export import own
from twilight.export.values import Source
from twilight.progress import Progress, part_of, silent
from twilight.sky import Sky
from twilight.spectrum import DEFAULT_SOLAR_SPECTRUM
from twilight.window import lines, tables
from twilight.window.colours import Channels
from twilight.window.pack import Pack
from twilight.window.page import View

MOST_FIELDS = 2
LOWEST_SUN_DEG = -18.0
GRID_ROWS, GRID_COLUMNS = 91, 180
"""Of one computed sky: each degree of elevation, every second of azimuth."""


def view_field(solved: Solved, **options: Any) -> View:
    """The page of one field; options as `view_fields`."""
    return view_fields([solved], **options)


def view_fields(
    fields: Sequence[Solved],
    *,
    names: Sequence[str] | None = None,
    scenes: Sequence[str] | None = None,
    altitudes_km: Sequence[float] | None = None,
    solar_spectrum: str = DEFAULT_SOLAR_SPECTRUM,
    start: dict[str, Any] | None = None,
    sizes: tables.Sizes | None = None,
    progress: Progress | None = None,
) -> View:
    """The page of one field, or of two side by side.

    names: what the page calls them; scenes: what `twilight render` is to be given in their place.  altitudes_km: of the
    observer, increasing, above sea level; None: the one of the field.  Between several the page interpolates.
    start: the page's first settings, by the names of `web/state.js`.
    Errors: TwilightError for a field that cannot show every sun and direction, and an altitude it does not reach.
    """
    if not 1 <= len(fields) <= MOST_FIELDS:
        raise TwilightError(f"view: shows 1 or {MOST_FIELDS} fields, not {len(fields)}")
    tell, sizes = progress or silent, sizes or tables.Sizes()
    names = names or [solved.medium.name or f"field {i + 1}" for i, solved in enumerate(fields)]
    altitudes = check_altitudes(fields[0].problem, altitudes_km, names[0])
    pack = Pack(_about("field", names, scenes or names, start or {}))
    pack.header |= {
        "altitude_km": list(altitudes),
        "texels": {"sun": sizes.suns, "ground": sizes.ground, "sky": sizes.sky, "azimuth": sizes.azimuths},
        "sun_deg": [LOWEST_SUN_DEG, 90.0],
        "sun_axis": [own.LOWEST_SUN_DEG, own.SUN_CENTRE_DEG, own.SUN_WIDTH_DEG],
        "azimuth_power": own.AZIMUTH_POWER,
    }
    for k, solved in enumerate(fields):
        check_altitudes(solved.problem, altitudes, names[k])
        _check_suns(solved, names[k])
        channels = Channels(solved.medium.wavelength_nm, solar_spectrum)
        source = Source(solved, solved.medium, bool(getattr(solved.problem.settings, "refraction", False)))
        share = part_of(tell, k / len(fields), 1.0 / len(fields), names[k])
        made = tables.fill(source, channels, altitudes, sizes, share)
        pack.header["fields"].append(_facts(channels) | {"horizon_deg": made.horizon_deg.tolist()})
        pack.logarithm(f"sky{k}", made.sky)
        pack.logarithm(f"spectrum{k}", made.spectrum)
        if made.aureole is not None and made.phase is not None:
            pack.logarithm(f"aureole{k}", made.aureole)
            pack.numbers(f"phase{k}", np.log(made.phase))
        for i, altitude in enumerate(altitudes):
            horizon = float(made.horizon_deg[i])
            lifted, beam = lines.sunbeam(solved, channels, altitude, horizon)
            pack.numbers(f"lifted{k}_{i}", lifted)
            pack.numbers(f"beam{k}_{i}", np.log(beam))
            night, ground = lines.night(solved.medium, channels, altitude, horizon)
            for name, values in (("night", night), ("night_ground", ground)):
                pack.numbers(f"{name}{k}_{i}", channels.of(values / channels.solar_irradiance))
                pack.numbers(f"{name}_spectrum{k}_{i}", values)
    pack.numbers("zodiacal", np.log(lines.zodiacal_table()))
    pack.numbers("stars", _stars())
    return View(pack, f"{' and '.join(names)}: sky")


def view_sky(sky: Sky, *, name: str = "", start: dict[str, Any] | None = None) -> View:
    """The page of one computed or measured sky: one sun, and no light but what the sky holds."""
    configuration = sky.provenance.get("configuration") or {}
    name = name or str((configuration.get("climate") or {}).get("name") or "sky")
    pack = Pack(_about("sky", [name], [name], {"sun": sky.sun_elevation_deg} | (start or {})))
    rows = np.linspace(0.0, 90.0, GRID_ROWS)
    columns = np.arange(GRID_COLUMNS) * (360.0 / GRID_COLUMNS)
    channels = Channels(sky.wavelength_nm, sky.solar_spectrum)
    light = np.maximum(channels.of(sky.normalised_radiance), tables.DARK) / sky.distance_au**2
    light = np.moveaxis(sky.smooth(light, rows[:, None], columns[None, :]), -1, 0)
    spectra = sky.smooth(np.maximum(sky.normalised_radiance, tables.DARK), rows[::5][:, None], columns[::5][None, :])
    pack.header |= {
        "altitude_km": [sky.observer_altitude_km],
        "texels": {"sun": 1, "ground": 0, "sky": GRID_ROWS, "azimuth": GRID_COLUMNS},
        "sun_deg": [sky.sun_elevation_deg, sky.sun_elevation_deg],
        "sun_azimuth_deg": sky.sun_azimuth_deg,
        "distance_au": sky.distance_au,
    }
    pack.header["fields"].append(_facts(channels) | {"horizon_deg": [0.0]})
    pack.logarithm("sky0", light[:, None, None])
    pack.logarithm("spectrum0", np.moveaxis(spectra, -1, 0)[:, None, None])
    return View(pack, f"{name}: sky")


def _about(kind: str, names: Sequence[str], scenes: Sequence[str], start: dict[str, Any]) -> dict[str, Any]:
    return {
        "program": f"twilight {__version__}",
        "kind": kind,
        "names": list(names),
        "scenes": list(scenes),
        "start": start,
        "fields": [],
    }


def _facts(channels: Channels) -> dict[str, Any]:
    return {
        "wavelength_nm": channels.wavelength_nm.tolist(),
        "solar_irradiance": channels.solar_irradiance.tolist(),
    }


def check_altitudes(problem: Problem, altitudes_km: Sequence[float] | None, name: str) -> tuple[float, ...]:
    """The altitudes of the observer [km] that a page will have, None: the one of the problem.

    Errors: TwilightError for a solver that cannot show every sun and direction, and an altitude it does not reach.
    """
    able, medium = problem.capabilities, problem.medium
    if not (able.every_sun and able.below_horizon and able.looks_down) or able.standard_error:
        raise TwilightError(f"{name}: its solver has no sky for every sun and direction; zones has")
    altitudes = (problem.altitude_km,) if altitudes_km is None else tuple(float(z) for z in altitudes_km)
    if len(altitudes) > 1 and not able.every_observer:
        raise TwilightError(f"{name}: its solver serves one altitude of the observer, not {len(altitudes)}; zones does")
    if list(altitudes) != sorted(set(altitudes)):
        raise TwilightError(f"altitudes: {', '.join(f'{z:g}' for z in altitudes)} km must increase")
    low, high = medium.bottom_km, medium.top_km
    for z in altitudes:
        if not low <= z <= high:
            raise TwilightError(f"altitudes: {z:g} km is not allowed, {low:g} (the ground) to {high:g} km (the top) is")
    return altitudes


def _check_suns(solved: Solved, name: str) -> None:
    """Raise TwilightError for a field that was not solved for all suns."""
    low, high = getattr(solved.blocks[0].field, "sun_range_deg", (-90.0, 90.0))
    if low > own.LOWEST_SUN_DEG or high < 90.0:
        raise TwilightError(f"{name}: its field was solved for suns from {low:g} to {high:g} deg, not for all")


def _stars() -> np.ndarray:
    """Unit vectors (equator and equinox of J2000) and magnitudes of the brighter stars, (N, 4)."""
    from twilight.validate.stars.catalogue import bright_stars

    stars = bright_stars(2026.0)
    return np.column_stack([stars.directions, stars.magnitude])
