"""`twilight light`: what shines on directions and surfaces at a place and a time, as a table."""

import sys
from typing import Annotated

from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table, progress_bar


def light(
    climate: Annotated[str, options.CLIMATE],
    at: Annotated[list[str], option("TIME", "E.g. 2026-06-21T22:15, or '2026-06-21 civil dusk'; may be repeated.")],
    place: options.Place,
    keys: options.ObserverSettings,
    quantity: Annotated[
        list[str] | None,
        option(
            "NAME",
            "V, luminance, illuminance, melanopic, cct ...; without it, V and luminance "
            "of directions, illuminance of surfaces; may be repeated.",
        ),
    ] = None,
    towards: Annotated[
        list[str] | None,
        option(
            "WHERE",
            "zenith, ELEVATION/AZIMUTH, horizontal, plane:TILT/AZIMUTH, sphere, cylinder; "
            "azimuth from north, or sun, sun+90; may be repeated.",
        ),
    ] = None,
    source: Annotated[
        list[str] | None,
        option("NAME", "sun, sky, moon, airglow, stars, zodiacal_light, light_pollution, ground; without it, all."),
    ] = None,
) -> None:
    """Print the light of directions or surfaces at a place and times: sun, sky, moon, stars, airglow, ground.

    docs/quantities.md lists the quantities with their sources.
    """
    from twilight.api.light import light as light_of
    from twilight.sky.quantities.measure import quantity as known
    from twilight.sky.surfaces import Surface
    from twilight.sky.surfaces import towards as read

    where = towards or ["zenith"]
    surfaces = [item for item in where if isinstance(read(item), Surface)]
    directions = [item for item in where if item not in surfaces]
    asked = [known(name) for name in quantity] if quantity else None
    rows: list[list[str]] = []
    said: dict[str, None] = {}
    for of, some, usual in (("direction", directions, ("V", "luminance")), ("surface", surfaces, ("illuminance",))):
        if not some:
            continue
        wanted = asked or [known(name) for name in usual]
        if len(directions) and len(surfaces) and asked:
            wanted = [item for item in asked if of in item.of]
            if not wanted:
                continue
        with progress_bar() as progress:
            values = light_of(
                (place.latitude, place.longitude), list(at), some, wanted, climate, sources=source,
                time_zone=place.time_zone, altitude_km=keys.altitude_km, quality=keys.quality,
                settings=options.settings_of(keys.settings)[0], progress=progress,
            )  # fmt: skip
        if " " in values.attrs["solver"]:
            said[values.attrs["solver"]] = None
        for t, text in enumerate(at):
            for d, target in enumerate(some):
                for item in wanted:
                    cell = values[item.variable].isel({"time": t, of: d})
                    sun = float(values["solar_elevation_angle"].isel(time=t))
                    rows.append([text, f"{sun:.2f}", target, item.name, f"{float(cell):.5g}", str(cell.attrs["units"])])
    for sentence in said:
        print(f"twilight: {sentence}", file=sys.stderr)
    print_table(["time", "sun [deg]", "towards", "quantity", "value", "unit"], rows, right=(1, 4))
