"""`twilight times`: sunrise, sunset, and the dawns and dusks of a place and date."""

from __future__ import annotations

from typing import Annotated

from twilight.base.errors import TwilightError
from twilight.cli.options import option, within
from twilight.cli.terminal import print_table


def times(
    latitude: Annotated[float, option("DEG", "North positive.")],
    longitude: Annotated[float, option("DEG", "East positive.")],
    date: Annotated[str | None, option("DATE", "E.g. 2026-06-21; without it, today.")] = None,
    time_zone: Annotated[str | None, option("ZONE", "E.g. Europe/Berlin; without it, UTC.")] = None,
    altitude_km: Annotated[float, option("KM", "Altitude of the observer above sea level.")] = 0.0,
) -> None:
    """List sunrise, solar noon, sunset, and civil, nautical and astronomical dawn and dusk of a place and date.

    Elevations are of the sun's centre, without refraction.  `twilight render --at 'DATE civil dusk'` takes these names.
    """
    import datetime as dt

    from twilight.sky.twilight_times import today_at, twilight_times

    within(latitude, "--latitude", -90.0, 90.0)
    within(longitude, "--longitude", -720.0, 720.0)
    try:
        day = today_at(longitude, time_zone) if date is None else dt.date.fromisoformat(date)
    except ValueError:
        raise TwilightError(f"--date: {date} is not a date such as 2026-06-21") from None
    longitude = longitude if -180.0 <= longitude <= 360.0 else (longitude + 180.0) % 360.0 - 180.0
    rows = []
    for event in twilight_times(day, latitude, longitude, time_zone, altitude_km):
        if event.time is None:
            rows.append([event.event, "the sun does not get there", f"{event.elevation_deg:.2f}", ""])
        else:
            time = event.time.isoformat(sep=" ", timespec="seconds")
            rows.append([event.event, time, f"{event.elevation_deg:.2f}", f"{event.azimuth_deg:.1f}"])
    print_table(["event", "time", "sun elevation [deg]", "azimuth [deg]"], rows, right=(2, 3))
