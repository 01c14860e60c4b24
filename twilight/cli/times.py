"""`twilight times`: sunrise, sunset, dawns, dusks and the moon of a place and date."""

from typing import Annotated

from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table


def times(
    place: options.Place,
    date: Annotated[str | None, option("DATE", "E.g. 2026-06-21; without it, today.")] = None,
    altitude_km: Annotated[float, options.ALTITUDE_KM] = 0.0,
) -> None:
    """List sunrise, solar noon, sunset, civil, nautical and astronomical dawn and dusk, moonrise and moonset.

    Elevations are of the centres, without refraction; the azimuth is that of the event's body.  `twilight render --at
    'DATE civil dusk'` takes the names of the sun's.
    """
    from twilight.sky.ephemeris import sun_position
    from twilight.sky.moon import moon_over
    from twilight.sky.twilight_times import moon_times, today_at, twilight_times

    latitude, longitude, time_zone = place.latitude, place.longitude, place.time_zone
    day = today_at(longitude, time_zone) if date is None else options.parse_date(date, "--date")
    rows = []
    where = latitude, longitude, time_zone, altitude_km
    for event in (*twilight_times(day, *where), *moon_times(day, *where)):
        if event.time is None:
            rows.append([event.event, "the sun does not get there", f"{event.elevation_deg:.2f}", "", "", ""])
            continue
        sun = sun_position(event.time, latitude, longitude, altitude_km)
        moon = moon_over(event.time, latitude, longitude, float(sun.azimuth_deg), altitude_km)
        lit = f"{100 * moon.illuminated_fraction:.0f} %, {'waxing' if moon.waxing else 'waning'}"
        time, angles = event.time.isoformat(sep=" ", timespec="seconds"), (sun.elevation_deg, event.azimuth_deg or 0.0)
        rows.append([event.event, time, f"{angles[0]:.2f}", f"{angles[1]:.1f}", f"{moon.elevation_deg:.1f}", lit])
    columns = ["event", "time", "sun elevation [deg]", "azimuth [deg]", "moon elevation [deg]", "moon lit"]
    print_table(columns, rows, right=(2, 3, 4))
