"""From solved fields, or one computed sky, to a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twilight import __version__
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.engine import Solved
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM
from twilight.scene import Scene
from twilight.sky.sky import Sky
from twilight.sky.stars import bright_stars
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import FieldSource
from twilight.viewer import lines, space, tables, tones
from twilight.viewer.colours import Channels
from twilight.viewer.moonlight import MoonColours, page_header
from twilight.viewer.pack import Pack
from twilight.viewer.page import Page

MOST_FIELDS = 2
"""Skies that a page shows beside each other."""
LOWEST_SUN_DEG = -18.0
"""Lowest sun that the page shows."""
INNER_KM = (2.0, 5.0, 10.0, 20.0, 40.0, 65.0)
"""Heights above the ground of the observers of `ground_to_orbit` within the air."""
ORBIT_KM = 1000.0
"""Height of the highest observer of `ground_to_orbit`."""
HIGHEST_KM = 40000.0
"""Highest observer, beyond a geostationary orbit."""
GRID_ROWS = 91
"""Elevations of one computed sky: each degree."""
GRID_COLUMNS = 180
"""Azimuths of one computed sky: every other degree."""


def view_fields(
    fields: Sequence[Solved],
    *,
    names: Sequence[str] | None = None,
    scenes: Sequence[str] | None = None,
    altitudes_km: Sequence[float] | None = None,
    solar_spectrum: str = DEFAULT_SOLAR_SPECTRUM,
    start: dict[str, Any] | None = None,
    sizes: tables.ViewerTableSizes | None = None,
    progress: Progress | None = None,
) -> Page:
    """The page of one field, or of two side by side.

    Parameters
    ----------
    fields
        One or two fields, solved for all suns.
    names
        What the page calls them; None: the names of their media.
    scenes
        What `twilight render` is given to compute them, for a shell; None: the page has no command to copy.
    altitudes_km
        Altitudes of the observer above sea level [km], increasing; None: the one of the field.  Between several the
        page interpolates; one above the air, the last, lets it go up to there, with tables of the top of the air.
        `ground_to_orbit` has a usual choice.
    solar_spectrum
        Name of the solar spectrum that radiances are multiplied with.
    start
        The page's first settings, by the names of `web/state.js`.
    sizes
        Texels of the tables; None: the usual ones.
    progress
        Called as progress(doing, fraction) now and then.

    Returns
    -------
    Page

    Raises
    ------
    TwilightError
        For a field that cannot show every sun and direction, and an altitude that it does not serve.
    """
    if not 1 <= len(fields) <= MOST_FIELDS:
        raise TwilightError(f"view: shows 1 or {MOST_FIELDS} fields, not {len(fields)}")
    tell, sizes = progress or silent, sizes or tables.ViewerTableSizes()
    names = names or [solved.medium.name or f"field {i + 1}" for i, solved in enumerate(fields)]
    asked = check_altitudes(fields[0].scene, altitudes_km, names[0])
    altitudes, orbit_km = within_air(fields[0].medium, asked)
    pack = Pack(_about("field", names, scenes or [], start or {}))
    pack.header |= {
        "altitude_km": list(altitudes),
        "ground_km": min(solved.medium.bottom_km for solved in fields),
        "highest_km": asked[-1],
        "texels": _texels(sizes.suns, sizes.ground, sizes.haze, sizes.sky, sizes.azimuths),
        "sun_deg": [LOWEST_SUN_DEG, 90.0],
        "sun_axis": [sky_tables.LOWEST_SUN_DEG, sky_tables.SUN_CENTRE_DEG, sky_tables.SUN_WIDTH_DEG],
        "azimuth_power": sky_tables.AZIMUTH_POWER,
        "moon": page_header(),
    }
    if orbit_km:
        pack.header["space"] = {
            "from_km": altitudes[-1],
            "limb": sizes.limb,
            "limb_power": space.LIMB_POWER,
            "edge_km": space.TOP_EDGE_KM,
            "lines_to_km": space.LINES_TO_KM,
        }
    for k, solved in enumerate(fields):
        check_altitudes(solved.scene, asked, names[k])
        _check_suns(solved, names[k])
        fraction = part_of(tell, k / len(fields), 1.0 / len(fields), names[k])
        _add_field(pack, k, solved, Channels(solved.medium.wavelength_nm, solar_spectrum), altitudes, sizes, fraction)
    _add_tones(pack)
    pack.numbers("zodiacal", np.log(lines.zodiacal_table()))
    pack.numbers("stars", _stars())
    return Page(pack, f"{' and '.join(names)}: sky")


def _add_field(
    pack: Pack,
    k: int,
    solved: Solved,
    channels: Channels,
    altitudes: tuple[float, ...],
    sizes: tables.ViewerTableSizes,
    progress: Progress,
) -> None:
    """The tables and lines of one field."""
    source = FieldSource(solved, solved.medium, bool(getattr(solved.scene.settings, "refraction", False)))
    steps = len(altitudes) + 2 * ("space" in pack.header)
    made = tables.fill(source, channels, altitudes, sizes, part_of(progress, 0.0, len(altitudes) / steps))
    colours = MoonColours.of(made.spectrum.reshape(channels.wavelength_nm.size, -1).T, channels)
    pack.header["fields"].append(
        _facts(channels)
        | {
            "horizon_deg": made.horizon_deg.tolist(),
            "haze_deg": made.haze_deg.tolist(),
            "haze_top_km": source.haze_top_km(),
        }
        | colours.page_header(channels.wavelength_nm)
    )
    _add_tables(pack, k, "", made)
    for i, altitude in enumerate(altitudes):
        nodes = lines.sky_elevations(float(made.horizon_deg[i]))
        _add_lines(pack, channels, f"{k}_{i}", lines.sunbeam(solved, channels, altitude, nodes),
                   lines.night(solved.medium, altitude, nodes))  # fmt: skip
    if "space" not in pack.header:
        return
    made, geometry = space.fill_space(source, channels, sizes, part_of(progress, len(altitudes) / steps, 2.0 / steps))
    pack.header["fields"][k] |= {
        "radius_km": solved.medium.earth_radius_km,
        "grazing_km": geometry.grazing_km,
        "haze_km": geometry.haze_km,
        "top_radius_km": geometry.top_radius_km,
    }
    _add_tables(pack, k, "space_", made)
    above = solved.medium.earth_radius_km + space.ABOVE_AIRGLOW_KM
    _add_lines(
        pack,
        channels,
        f"{k}_space",
        lines.sunbeam(solved, channels, geometry.top_km, geometry.line_elevations(geometry.top_radius_km)),
        lines.night(solved.medium, space.ABOVE_AIRGLOW_KM, geometry.line_elevations(above)),
    )


def _add_tables(pack: Pack, k: int, where: str, made: tables.ViewerTables) -> None:
    pack.logarithm(f"{where}sky{k}", made.sky)
    pack.logarithm(f"{where}spectrum{k}", made.spectrum)
    if made.aureole is not None and made.phase is not None:
        pack.logarithm(f"{where}aureole{k}", made.aureole)
        pack.numbers(f"phase{k}", np.log(made.phase))


def _add_tones(pack: Pack) -> None:
    pack.header["tone"] = tones.header()
    for name, values in tones.eye_tables().items():
        pack.numbers(name, values)


def _add_lines(pack: Pack, channels: Channels, which: str, sun: tuple, night: tuple) -> None:
    refraction_deg, beam = sun
    pack.numbers(f"refraction_deg{which}", refraction_deg)
    pack.numbers(f"beam{which}", np.log(beam))
    for name, values in zip(("night", "night_ground"), night, strict=True):
        pack.numbers(f"{name}{which}", channels.of(values / channels.solar_irradiance))
        pack.numbers(f"{name}_spectrum{which}", values)


def ground_to_orbit(medium: Medium) -> tuple[float, ...]:
    """Altitudes of the observer above sea level [km], increasing, from the ground through the air to an orbit."""
    inner = (medium.bottom_km + z for z in INNER_KM)
    return (medium.bottom_km, *(z for z in inner if z < 0.9 * medium.top_km), medium.top_km, ORBIT_KM)


def within_air(medium: Medium, altitudes_km: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
    """The altitudes within the air, its top among them where there are higher ones, and the highest of those, or 0."""
    inside = tuple(z for z in altitudes_km if z <= medium.top_km)
    if len(inside) == len(altitudes_km):
        return inside, 0.0
    return (*(z for z in inside if z < medium.top_km), medium.top_km), altitudes_km[-1]


def view_sky(sky: Sky, *, name: str = "", start: dict[str, Any] | None = None) -> Page:
    """The page of one computed or measured sky: one sun, and no light but what the sky holds.

    name: what the page calls the sky, empty: the name of its climate; start: as of `view_fields`.
    """
    configuration = sky.provenance.get("configuration") or {}
    name = name or str((configuration.get("climate") or {}).get("name") or "sky")
    pack = Pack(_about("sky", [name], [], {"sun": sky.sun_elevation_deg} | (start or {})))
    rows = np.linspace(0.0, 90.0, GRID_ROWS)
    columns = np.arange(GRID_COLUMNS) * (360.0 / GRID_COLUMNS)
    channels = Channels(sky.wavelength_nm, sky.solar_spectrum)
    light = np.maximum(channels.of(sky.normalised_radiance), tables.DARK) / sky.distance_au**2
    light = np.moveaxis(sky.smooth(light, rows[:, None], columns[None, :]), -1, 0)
    spectra = sky.smooth(np.maximum(sky.normalised_radiance, tables.DARK), rows[::5][:, None], columns[::5][None, :])
    pack.header |= {
        "altitude_km": [sky.observer_altitude_km],
        "highest_km": sky.observer_altitude_km,
        "texels": _texels(1, 0, 0, GRID_ROWS, GRID_COLUMNS),
        "sun_deg": [sky.sun_elevation_deg, sky.sun_elevation_deg],
        "sun_azimuth_deg": sky.sun_azimuth_deg,
        "distance_au": sky.distance_au,
    }
    pack.header["fields"].append(_facts(channels) | {"horizon_deg": [0.0], "haze_deg": [0.0]})
    pack.logarithm("sky0", light[:, None, None])
    pack.logarithm("spectrum0", np.moveaxis(spectra, -1, 0)[:, None, None])
    _add_tones(pack)
    return Page(pack, f"{name}: sky")


def _about(kind: str, names: Sequence[str], scenes: Sequence[str], start: dict[str, Any]) -> dict[str, Any]:
    return {
        "program": f"twilight {__version__}",
        "kind": kind,
        "names": list(names),
        "scenes": list(scenes),
        "start": start,
        "fields": [],
    }


def _texels(*counts: int) -> dict[str, int]:
    """Texels of a page's tables along each of their axes, by the names that its scripts know."""
    return dict(zip(("sun", "ground", "haze", "sky", "azimuth"), counts, strict=True))


def _facts(channels: Channels) -> dict[str, Any]:
    return {"wavelength_nm": channels.wavelength_nm.tolist(), "solar_irradiance": channels.solar_irradiance.tolist()}


def check_altitudes(scene: Scene, altitudes_km: Sequence[float] | None, name: str) -> tuple[float, ...]:
    """The altitudes of the observer above sea level [km] that a page will go through.

    scene: what the field was solved for; altitudes_km: as of `view_fields`; name: what errors call the field.
    Errors: TwilightError for a solver that cannot show every sun and direction, and an altitude that it does not serve.
    """
    able, medium = scene.capabilities, scene.medium
    if not (able.every_sun and able.kind != "formula" and able.looks_down) or able.standard_error:
        raise TwilightError(f"{name}: its solver has no sky for every sun and direction; zones has")
    altitudes = (scene.altitude_km,) if altitudes_km is None else tuple(float(z) for z in altitudes_km)
    if len(altitudes) > 1 and not able.every_observer:
        raise TwilightError(f"{name}: its solver serves one altitude of the observer, not {len(altitudes)}; zones does")
    if list(altitudes) != sorted(set(altitudes)):
        raise TwilightError(f"altitudes: {', '.join(f'{z:g}' for z in altitudes)} km must increase")
    low, high = medium.bottom_km, HIGHEST_KM
    for z in altitudes:
        if not low <= z <= high:
            raise TwilightError(f"altitudes: {z:g} km is not allowed, {low:g} (the ground) to {high:g} km is")
    if altitudes[-1] > medium.top_km and not able.every_observer:
        raise TwilightError(f"{name}: its solver serves one altitude of the observer, in the air; zones serves all")
    return altitudes


def _check_suns(solved: Solved, name: str) -> None:
    """Raise TwilightError for a field that was not solved for all suns."""
    low, high = getattr(solved.blocks[0].field, "sun_range_deg", (-90.0, 90.0))
    if low > sky_tables.LOWEST_SUN_DEG or high < 90.0:
        raise TwilightError(f"{name}: its field was solved for suns from {low:g} to {high:g} deg, not for all")


def _stars() -> np.ndarray:
    """Unit vectors (equator and equinox of J2000) and magnitudes of the brighter stars, (N, 4)."""
    stars = bright_stars(2026.0)
    return np.column_stack([stars.directions, stars.magnitude])
