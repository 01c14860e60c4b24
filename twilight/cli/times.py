"""`twilight times`: sunrise, sunset, and the dawns and dusks of a place and date."""

from typing import Annotated

from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table


def times(
    latitude: Annotated[float, options.LATITUDE],
    longitude: Annotated[float, options.LONGITUDE],
    date: Annotated[str | None, option("DATE", "E.g. 2026-06-21; without it, today.")] = None,
    time_zone: Annotated[str | None, options.TIME_ZONE] = None,
    altitude_km: Annotated[float, options.ALTITUDE_KM] = 0.0,
) -> None:
    """List sunrise, solar noon, sunset, and civil, nautical and astronomical dawn and dusk of a place and date.

    Elevations are of the sun's centre, without refraction.  `twilight render --at 'DATE civil dusk'` takes these names.
    """
    from twilight.sky.twilight_times import today_at, twilight_times

    options.check_range(latitude, "--latitude", -90.0, 90.0)
    options.check_range(longitude, "--longitude", -720.0, 720.0)
    day = today_at(longitude, time_zone) if date is None else options.parse_date(date, "--date")
    longitude = longitude if -180.0 <= longitude <= 360.0 else (longitude + 180.0) % 360.0 - 180.0
    rows = []
    for event in twilight_times(day, latitude, longitude, time_zone, altitude_km):
        if event.time is None:
            rows.append([event.event, "the sun does not get there", f"{event.elevation_deg:.2f}", ""])
        else:
            time = event.time.isoformat(sep=" ", timespec="seconds")
            rows.append([event.event, time, f"{event.elevation_deg:.2f}", f"{event.azimuth_deg:.1f}"])
    print_table(["event", "time", "sun elevation [deg]", "azimuth [deg]"], rows, right=(2, 3))
