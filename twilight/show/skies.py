"""From solved fields, or one computed sky, to a page."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from twilight import __version__
from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.engine import Field
from twilight.engine.sun_tables import LOWEST_SUN_DEG as LOWEST_TABLE_DEG
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM
from twilight.scene import Scene
from twilight.show import page, space, tones
from twilight.show.lights import MoonColours, night_lines, page_header, sky_elevations, sunbeam, zodiacal_table
from twilight.show.page import Pack, Page
from twilight.show.tones import Channels, padded_columns
from twilight.sky.night.points import bright_stars
from twilight.sky.sky import Sky
from twilight.sky.table import DARKEST, SkyTable

MOST_FIELDS = 2
"""Skies that a page shows beside each other."""
LOWEST_SUN_DEG = -18.0
"""Lowest sun that the page shows [deg]."""
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
    fields: Sequence[Field],
    *,
    names: Sequence[str] | None = None,
    scenes: Sequence[str] | None = None,
    altitudes_km: Sequence[float] | None = None,
    solar_spectrum: str = DEFAULT_SOLAR_SPECTRUM,
    start: dict[str, Any] | None = None,
    nodes: page.PageNodes | None = None,
    progress: Progress | None = None,
) -> Page:
    """The page of one field, or of two side by side, solved for all suns.

    names: what the page calls them; None: the names of their media
    scenes: what `twilight render` is given to compute them, for a shell; None: the page has no command to copy
    altitudes_km: of the observer above sea level [km], increasing; None: the one of the field.  Between several the
        page interpolates; one above the air, the last, lets it go up to there, with tables of the top of the air
        (`ground_to_orbit`: a usual choice)
    solar_spectrum: name of the one that radiances are multiplied with; start: the page's first settings, by the names
        of `web/state.js`; nodes: rows and columns of the tables, None: the usual ones
    Errors: TwilightError for a field that cannot show every sun and direction, and an altitude that it does not
        serve."""
    if not 1 <= len(fields) <= MOST_FIELDS:
        raise TwilightError(f"view: shows 1 or {MOST_FIELDS} fields, not {len(fields)}")
    tell, nodes = progress or silent, nodes or page.PageNodes()
    names = names or [solved.medium.name or f"field {i + 1}" for i, solved in enumerate(fields)]
    asked = check_altitudes(fields[0].scene, altitudes_km, names[0])
    altitudes, orbit_km = within_air(fields[0].medium, asked)
    pack = Pack(about_page("field", names, scenes or [], start or {}))
    pack.header |= {
        "altitude_km": list(altitudes),
        "ground_km": min(solved.medium.bottom_km for solved in fields),
        "highest_km": asked[-1],
        "rise": [part.tolist() for part in nodes.rises()],
        "least_haze_deg": page.LEAST_HAZE_DEG,
        **_node_facts(nodes),
        "sun_deg": [LOWEST_SUN_DEG, 90.0],
        "moon": page_header(),
    }
    if orbit_km:
        pack.header["space"] = {
            "from_km": altitudes[-1],
            **_node_facts(nodes, space=True),
            "line_power": space.LINE_POWER,
            "edge_km": space.TOP_EDGE_KM,
            "lines_to_km": space.LINES_TO_KM,
        }
    for k, solved in enumerate(fields):
        check_altitudes(solved.scene, asked, names[k])
        _check_suns(solved, names[k])
        fraction = part_of(tell, k / len(fields), 1.0 / len(fields), names[k])
        _add_field(pack, k, solved, Channels(solved.medium.wavelength_nm, solar_spectrum), altitudes, nodes, fraction)
    add_tones(pack)
    pack.numbers("zodiacal", np.log(zodiacal_table()))
    pack.numbers("stars", _stars())
    return Page(pack, f"{' and '.join(names)}: sky")


def _node_facts(nodes: page.PageNodes, *, space: bool = False) -> dict[str, list[float]]:
    """Columns of the tables and of the spectral ones, and which rows these have."""
    columns = nodes.columns_deg(space=space)
    return {
        "column_deg": padded_columns(columns)[0].tolist(),
        "spectrum_column_deg": padded_columns(columns[::2])[0].tolist(),
        "spectrum_rows": nodes.every_second_row(space=space).tolist(),
    }


def _add_field(
    pack: Pack,
    k: int,
    solved: Field,
    channels: Channels,
    altitudes: tuple[float, ...],
    nodes: page.PageNodes,
    progress: Progress,
) -> None:
    """The tables and lines of one field."""
    steps = len(altitudes) + 2 * ("space" in pack.header)
    spectra = [
        page.spectra_at(solved, z, nodes, part_of(progress, i / steps, 1.0 / steps)) for i, z in enumerate(altitudes)
    ]
    edges = [page.horizon_and_haze_deg(solved, altitude) for altitude in altitudes]
    suns, kept = spectra[0].sun_elevation_deg, space.every_second(spectra[0].sun_elevation_deg.size)
    light = [one.light_at_nodes()[kept][:, nodes.every_second_row()][:, :, ::2] for one in spectra]
    colours = MoonColours.of(np.stack(light), channels)
    pack.header["fields"].append(
        channel_facts(channels)
        | {
            "sun_node_deg": suns.tolist(),
            "spectrum_sun_deg": suns[kept].tolist(),
            "lift_deg": [(one.apparent_sun_deg - suns).tolist() for one in spectra],
            "horizon_deg": [horizon for horizon, _ in edges],
            "haze_deg": [haze for _, haze in edges],
            "haze_top_km": page.haze_top_km(solved),
        }
        | colours.page_header(channels.wavelength_nm)
    )
    seen = [one.seen(channels.of) for one in spectra]
    _add_tables(pack, f"sky{k}", f"aureole{k}", seen)
    _add_spectrum(pack, f"spectrum{k}", [np.log(np.maximum(one, 1e-37)) for one in light])
    for i, altitude in enumerate(altitudes):
        places = sky_elevations(edges[i][0])
        _add_lines(pack, channels, f"{k}_{i}", seen[i], sunbeam(solved, channels, altitude, places),
                   night_lines(solved.medium, altitude, places))  # fmt: skip
    if "space" not in pack.header:
        return
    above_air = part_of(progress, len(altitudes) / steps, 2.0 / steps)
    made, coarse, geometry = space.fill_space(solved, channels, nodes, above_air)
    pack.header["fields"][k] |= {
        "radius_km": solved.medium.earth_radius_km,
        "grazing_km": geometry.grazing_km,
        "top_radius_km": geometry.top_radius_km,
        "space_sun_deg": made.sun_elevation_deg.tolist(),
        "space_row": made.elevation_deg.tolist(),
        "space_spectrum_sun_deg": coarse.sun_elevation_deg.tolist(),
    }
    _add_tables(pack, f"space_sky{k}", f"space_aureole{k}", [made])
    _add_spectrum(pack, f"space_spectrum{k}", [coarse.smooth])
    above = solved.medium.earth_radius_km + space.ABOVE_AIRGLOW_KM
    beam = sunbeam(solved, channels, geometry.top_km, geometry.line_elevations(geometry.top_radius_km))
    night = night_lines(solved.medium, space.ABOVE_AIRGLOW_KM, geometry.line_elevations(above))
    _add_lines(pack, channels, f"{k}_space", made, beam, night)


def _add_tables(pack: Pack, smooth: str, aureole: str, tables: list[SkyTable]) -> None:
    """S and A of tables at several altitudes, columns as `padded_columns` has them: (4, altitude, sun, row, column)."""
    _, column = padded_columns(tables[0].azimuth_deg)
    for name, layers in ((smooth, [t.smooth for t in tables]), (aureole, [t.aureole for t in tables])):
        held = [layer[:, :, column] for layer in layers if layer is not None]
        if held:
            pack.logarithm(name, np.moveaxis(np.stack(held), -1, 0))


def _add_spectrum(pack: Pack, name: str, logs: list[np.ndarray]) -> None:
    """Logarithms of light (sun, row, column, W) at several altitudes: (W, altitude, sun, row, column)."""
    _, column = padded_columns(np.arange(logs[0].shape[2]))
    pack.logarithm(name, np.moveaxis(np.stack(logs)[:, :, :, column], -1, 0))


def add_tones(pack: Pack) -> None:
    """What the page's tones need."""
    pack.header["tone"] = tones.header()
    for name, values in tones.eye_tables().items():
        pack.numbers(name, values)


def _add_lines(pack: Pack, channels: Channels, which: str, table: SkyTable, sun: tuple, night: tuple) -> None:
    """What an altitude has of its own beside its table: the table's ln P, the sun's beam, the night's light."""
    if table.log_phase is not None:
        pack.numbers(f"phase{which}", table.log_phase)
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
    pack = Pack(about_page("sky", [name], [], {"sun": sky.sun_elevation_deg} | (start or {})))
    rows = np.linspace(0.0, 90.0, GRID_ROWS)
    columns = np.arange(GRID_COLUMNS) * (360.0 / GRID_COLUMNS)
    channels = Channels(sky.wavelength_nm, sky.solar_spectrum)
    around = np.concatenate([columns[-2:] - 360.0, columns, columns[:2] + 360.0])
    light = np.maximum(channels.of(sky.normalised_radiance), DARK) / sky.distance_au**2
    light = sky.smooth(light, rows[:, None], around[None, :])
    light = np.log(np.maximum(light, DARKEST * light.max(axis=(0, 1))))
    few, wide = rows[::5], np.concatenate([columns[::5][-2:] - 360.0, columns[::5], columns[::5][:2] + 360.0])
    spectra = sky.smooth(np.maximum(sky.normalised_radiance, DARK), few[:, None], wide[None, :])
    pack.header |= {
        "altitude_km": [sky.observer_altitude_km],
        "highest_km": sky.observer_altitude_km,
        "row_deg": rows.tolist(),
        "column_deg": around.tolist(),
        "spectrum_row_deg": few.tolist(),
        "spectrum_column_deg": wide.tolist(),
        "sun_deg": [sky.sun_elevation_deg, sky.sun_elevation_deg],
        "sun_azimuth_deg": sky.sun_azimuth_deg,
        "distance_au": sky.distance_au,
    }
    single = {"sun_node_deg": [sky.sun_elevation_deg], "spectrum_sun_deg": [sky.sun_elevation_deg], "lift_deg": [[0.0]]}
    pack.header["fields"].append(channel_facts(channels) | single | {"horizon_deg": [0.0], "haze_deg": [0.0]})
    pack.logarithm("sky0", np.moveaxis(light, -1, 0)[:, None, None])
    pack.logarithm("spectrum0", np.moveaxis(np.log(np.maximum(spectra, DARK)), -1, 0)[:, None, None])
    add_tones(pack)
    return Page(pack, f"{name}: sky")


def about_page(kind: str, names: Sequence[str], scenes: Sequence[str], start: dict[str, Any]) -> dict[str, Any]:
    """The header of every page."""
    return {
        "program": f"twilight {__version__}",
        "kind": kind,
        "names": list(names),
        "scenes": list(scenes),
        "start": start,
        "fields": [],
    }


def channel_facts(channels: Channels) -> dict[str, Any]:
    """What every page says of a field's wavelengths."""
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


def _check_suns(solved: Field, name: str) -> None:
    """Raise TwilightError for a field that was not solved for all suns."""
    low, high = solved.sun_range_deg
    if low > LOWEST_TABLE_DEG or high < 90.0:
        raise TwilightError(f"{name}: its field was solved for suns from {low:g} to {high:g} deg, not for all")


def _stars() -> np.ndarray:
    """Unit vectors (equator and equinox of J2000) and magnitudes of the brighter stars, (N, 4)."""
    stars = bright_stars(2026.0)
    return np.column_stack([stars.directions, stars.magnitude])
