"""`twilight visible`: when stars, planets and the moon come out, and the limiting magnitude over the sky."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import print_table, progress_bar

HEAD = ["object", "V mag", "seen from", "sun [deg]", "up [deg]", "to", "sun [deg]", "up [deg]", "best [mag]"]


def visible(
    what: Annotated[
        list[str] | None, argument("[OBJECT...]", "moon, a planet, a star by its name, planets, or stars; planets.")
    ] = None,
    *,
    latitude: Annotated[float, options.LATITUDE],
    longitude: Annotated[float, options.LONGITUDE],
    at: Annotated[
        str | None,
        option("DATE", "The night that begins on a date; for --map a time, or a date and a twilight. Today."),
    ] = None,
    time_zone: Annotated[str | None, options.TIME_ZONE] = None,
    climate: Annotated[
        str, option("NAME", "Climate or configuration: the air.", complete=options.climate_names)
    ] = "continental-average",
    field_factor: Annotated[
        float, option("F", "Factor on the thresholds of the laboratory (Crumey 2014): 1.4 keen, 2 typical, 2.4.")
    ] = 2.0,
    map_file: Annotated[Path | None, option("FILE.png", "Draw the limiting magnitude of --at.", "--map")] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
) -> None:
    """List when objects are seen with the naked eye, from noon to noon, or draw a map of the limiting magnitude.

    Twilight, moonlight, the night (--set night.light_pollution={bortle_class: 6}), extinction along refracted rays, and
    Crumey's thresholds: of eyes that know where to look. best: magnitudes above the limit.
    """
    from twilight.config import load
    from twilight.engine.light_setup import field_for
    from twilight.engine.visibility import NakedEye
    from twilight.sky.objects import names_of
    from twilight.sky.quantities.catalogue import quantity
    from twilight.sky.twilight_times import time_of, today_at
    from twilight.studies.visible.night import sightings

    options.check_range(latitude, "--latitude", -90.0, 90.0)
    options.check_range(longitude, "--longitude", -720.0, 720.0)
    options.check_range(field_factor, "--field-factor", 0.5, 10.0)
    longitude = longitude if -180.0 <= longitude <= 360.0 else (longitude + 180.0) % 360.0 - 180.0
    names = list(dict.fromkeys(name for word in what or ["planets"] for name in names_of(word)))
    config = load(climate, {"solver.quality": "draft", **options.settings_of(settings)[0]})
    if map_file is not None:
        if what:
            raise TwilightError("--map: draws the whole sky and takes no objects")
        options.check_suffix(map_file, "--map", ".png")
        moment = _moment(at, latitude, longitude, time_zone)
    else:
        example = "2026-06-21; a time goes with --map alone"
        date = options.parse_date(at, "--at", example) if at is not None else today_at(longitude, time_zone)
        noon = time_of(f"{date} solar noon", latitude, longitude, time_zone)
    with progress_bar() as progress:
        eye = NakedEye(field_for(config, [quantity("luminance")], progress), field_factor)
        if map_file is not None:
            from twilight.studies.visible.figure import draw_map

            values = draw_map(eye, latitude, longitude, moment, map_file)
        else:
            found = sightings(eye, latitude, longitude, names, noon, noon + dt.timedelta(hours=24))
    if map_file is not None:
        print(f"wrote {map_file}: stars to {values.max():.1f} mag at best, {values[-1, 0]:.1f} mag in the zenith")
        return
    print_table(HEAD, [row for name in names for row in _rows(name, found[name])], right=(1, 3, 4, 6, 7, 8))


def _rows(name: str, outlook: Any) -> list[list[str]]:
    if not outlook.sightings:
        if outlook.best_margin_mag == float("-inf"):
            return [[name, "", "stays below the horizon", *[""] * 6]]
        return [[name, "", "is not seen", *[""] * 5, f"{outlook.best_margin_mag:+.1f}"]]
    rows = []
    for s in outlook.sightings:
        times = [t.isoformat(sep=" ", timespec="seconds") for t in (s.first, s.last)]
        ends = [[f"{s.sun_deg[k]:.1f}", f"{s.elevation_deg[k]:.1f}"] for k in (0, 1)]
        rows.append([name, f"{s.magnitude:.1f}", times[0], *ends[0], times[1], *ends[1], f"{s.best_margin_mag:+.1f}"])
    return rows


def _moment(text: str | None, latitude: float, longitude: float, time_zone: str | None) -> dt.datetime:
    from twilight.sky.ephemeris import parse_time
    from twilight.sky.twilight_times import time_of

    if text is None:
        raise TwilightError("--map: needs --at with a time, such as 2026-06-21T22:30 or '2026-06-21 nautical dusk'")
    if ":" not in text:
        return time_of(text, latitude, longitude, time_zone)
    moment = parse_time(text, time_zone)
    if time_zone is None:
        return moment
    from zoneinfo import ZoneInfo

    return moment.astimezone(ZoneInfo(time_zone))
