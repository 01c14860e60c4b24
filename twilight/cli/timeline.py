"""`twilight timeline`: an evening as a table, with the times at which a quantity passes a value."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table

PURPOSES = ("darkness", "dawn", "reading", "melanopic", "flats")


def timeline(
    climate: Annotated[str, options.CLIMATE],
    at: Annotated[str, option("DATE", "The night from noon to noon, e.g. 2026-06-21.")],
    latitude: Annotated[float, options.LATITUDE],
    longitude: Annotated[float, options.LONGITUDE],
    purpose: Annotated[
        str | None,
        option(
            "NAME",
            "darkness, dawn, reading, melanopic or flats: columns and conditions; --quantity and --when add to them.",
            "--for",
        ),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        option("NAME[@WHERE]", "E.g. V@zenith, illuminance, CCT, limiting_magnitude, margin@venus; repeatable."),
    ] = None,
    when: Annotated[
        list[str] | None, option("CONDITION", "E.g. 'V@zenith > 21' or 'margin@venus > 0'; may be repeated.")
    ] = None,
    step: Annotated[str, option("DURATION", "Between rows, e.g. 30s, 1min, 1h.")] = "5min",
    start: Annotated[str | None, option("TIME", "First row, e.g. 2026-06-21T20:00 or '2026-06-21 sunset'.")] = None,
    stop: Annotated[str | None, option("TIME", "Last row.")] = None,
    time_zone: Annotated[str | None, options.TIME_ZONE] = None,
    altitude_km: Annotated[float | None, options.ALTITUDE_KM] = None,
    band: Annotated[str, option("NAME", "Filter of --for flats.")] = "V",
    aperture_m: Annotated[float, option("M", "Of the telescope of --for flats.")] = 1.0,
    obstruction_m: Annotated[float, option("M", "Diameter of its obstruction.")] = 0.0,
    pixel_arcsec: Annotated[float, option("ARCSEC", "Side of a pixel.")] = 0.5,
    throughput: Annotated[float, option("1", "Of filter, optics and detector where the band has its maximum.")] = 0.5,
    gain: Annotated[float, option("E", "Electrons of a count.")] = 1.0,
    level_counts: Annotated[float, option("COUNTS", "That a flat is to have.")] = 30_000.0,
    saturation_counts: Annotated[float, option("COUNTS", "That a pixel never exceeds.")] = 65_535.0,
    exposure_s: Annotated[float | None, option("S", "Of flats of one length, whose counts are tabulated.")] = None,
    field_factor: Annotated[float, option("F", "Of limiting_magnitude and margin: 1.4 keen, 2 typical, 2.4.")] = 2.0,
    quality: Annotated[str | None, options.QUALITY_LISTED] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("STEM", "Of the files; without it, out/NAME_timeline.")] = None,
) -> None:
    """Tabulate light through a night, as CSV, netCDF and a figure, and find when it passes a value.

    docs/quantities.md lists the quantities.
    """
    import datetime as dt

    from twilight.base.whole_files import check_file
    from twilight.config.load import load
    from twilight.config.validate import unknown
    from twilight.engine.light_setup import field_for
    from twilight.sky.ephemeris import parse_time
    from twilight.sky.twilight_times import time_of, twilight_times
    from twilight.studies.timeline import timeline as work
    from twilight.studies.timeline.columns import LimitColumn, MarginColumn, Setup, column
    from twilight.studies.timeline.files import draw, write_dataset, write_table
    from twilight.studies.timeline.flats import Flats
    from twilight.studies.timeline.presets import PRESETS

    options.check_range(latitude, "--latitude", -90.0, 90.0)
    options.check_range(longitude, "--longitude", -180.0, 360.0)
    if purpose is not None and purpose not in PURPOSES:
        raise TwilightError(f"--for: {purpose} {unknown(purpose, PURPOSES, 'purpose')}")
    day = options.parse_date(at, "--at")
    texts, conditions = list(quantity or ()), list(when or ())
    options.check_range(field_factor, "--field-factor", 0.5, 10.0)
    flats = Flats(
        band, aperture_m, obstruction_m, pixel_arcsec, throughput, gain, level_counts, saturation_counts, exposure_s
    )
    if purpose != "flats" and flats.changed:
        raise TwilightError(f"--{flats.changed.replace('_', '-')}: belongs to --for flats")
    setup = Setup(field_factor, flats if purpose == "flats" else None)
    preset = PRESETS.get(purpose or "")
    if preset is not None:
        texts, conditions = [*preset.columns, *texts], [*preset.conditions, *conditions]
    if purpose == "flats":
        texts, conditions = [flats.column, f"{band}@zenith", *texts], [*flats.conditions, *conditions]
    columns = [column(text, setup) for text in dict.fromkeys(texts or ["V@zenith", "illuminance"])]
    wanted = [work.condition(text, setup) for text in conditions]
    of_the_eye = any(isinstance(one, LimitColumn | MarginColumn) for one in (*columns, *(c.column for c in wanted)))
    if field_factor != Setup().field_factor and not of_the_eye:
        raise TwilightError("--field-factor: belongs to the columns limiting_magnitude and margin@OBJECT")

    keys, names = options.settings_of(settings)
    given = {"solver.quality": (quality, "--quality"), "observer.altitude_km": (altitude_km, "--altitude-km")}
    options.put_options(keys, names, given)
    config = load(climate, keys)
    place = latitude, longitude, time_zone, config.observer.altitude_km

    def moment(text: str) -> dt.datetime:
        try:
            dt.datetime.fromisoformat(text)
        except ValueError:
            return time_of(text, *place)
        return parse_time(text, time_zone).astimezone(marks[0].time.tzinfo)  # type: ignore[union-attr]

    noon = "solar noon"
    marks = [m for d in (day, day + dt.timedelta(days=1)) for m in twilight_times(d, *place) if m.event == noon]
    first = moment(start) if start else marks[0].time
    last = moment(stop) if stop else marks[1].time
    times = work.rows(first, last, work.step_of(step))  # type: ignore[arg-type]
    stem = output or Path("out") / f"{options.file_stem(config.name or config.climate.name, 'sky')}_timeline"
    paths = [stem.with_name(f"{stem.name}.{suffix}") for suffix in ("csv", "nc", "png")]
    for path in paths:
        check_file(path)
    stem.parent.mkdir(parents=True, exist_ok=True)
    field = field_for(config, [one.needs for one in (*columns, *(c.column for c in wanted))])
    made = work.timeline(field, latitude, longitude, times, columns, wanted, time_zone)
    about = f"{config.climate.name}, {latitude:g} {longitude:g}, {day.isoformat()}"
    write_table(made, paths[0], f"twilight timeline: {about}")
    write_dataset(made, paths[1], {"title": about})
    draw(made, paths[2], about)
    _print(made)
    if preset is not None:
        print(preset.about)
    for path in paths:
        print(f"wrote {path}")


def _print(made: Any) -> None:
    rows = []
    for mark in made.marks:
        if mark.time is None:
            rows.append([mark.event, "the sun does not get there", f"{mark.elevation_deg:.2f}"])
        else:
            rows.append([mark.event, _clock(mark.time), f"{mark.elevation_deg:.2f}"])
    for outcome in made.outcomes:
        text = outcome.condition.text
        if outcome.sentence:
            rows.append([text, outcome.sentence, ""])
        for crossing in outcome.crossings:
            word = "from" if crossing.begins else "until"
            rows.append([text, f"{word} {_clock(crossing.time)}", f"{crossing.sun_elevation_deg:.2f}"])
    print_table(["what", "time", "sun elevation [deg]"], rows, right=(2,))


def _clock(time: Any) -> str:
    return str(time.isoformat(sep=" ", timespec="seconds"))
