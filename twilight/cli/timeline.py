"""`twilight timeline`: an evening as a table, with the times at which a quantity passes a value."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table, progress_bar


def timeline(
    climate: Annotated[str, options.CLIMATE],
    place: options.Place,
    keys: options.ObserverSettings,
    at: Annotated[
        str | None, option("DATE", "The night from noon to noon, e.g. 2026-06-21; without it, of today.")
    ] = None,
    purpose: Annotated[
        str | None,
        option(
            "NAME",
            "darkness, reading or melanopic: columns and conditions; --quantity and --when add to them.",
            "--for",
        ),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        option("NAME[@WHERE]", "E.g. V@zenith, illuminance, CCT, melanopic@plane:90/sun; repeatable."),
    ] = None,
    when: Annotated[list[str] | None, option("CONDITION", "E.g. 'V@zenith > 21'; may be repeated.")] = None,
    step: Annotated[str, option("DURATION", "Between rows, e.g. 30s, 1min, 1h.")] = "5min",
    start: Annotated[str | None, option("TIME", "First row, e.g. 2026-06-21T20:00 or '2026-06-21 sunset'.")] = None,
    stop: Annotated[str | None, option("TIME", "Last row.")] = None,
    output: Annotated[
        Path | None,
        option("FILE", "X.csv, X.nc or X.png: that file; X: all three; without it, out/NAME_timeline."),
    ] = None,
) -> None:
    """Tabulate light through a night, as CSV, netCDF and a figure, and find when it passes a value.

    docs/quantities.md lists the quantities.
    """
    import datetime as dt

    from twilight.base.progress import part_of
    from twilight.base.sections import unknown
    from twilight.base.whole_files import check_file
    from twilight.config.load import load
    from twilight.engine.light import field_for
    from twilight.scene.usual import with_ozone_of
    from twilight.sky.twilight_times import moment_of, today_at, twilight_times
    from twilight.studies import timeline as work
    from twilight.studies.timeline import PRESETS, column
    from twilight.studies.timeline_files import NEEDED, WRITERS

    if purpose is not None and purpose not in PRESETS:
        raise TwilightError(f"--for: {purpose} {unknown(purpose, PRESETS, 'purpose')}")
    latitude, longitude, time_zone = place.latitude, place.longitude, place.time_zone
    day = today_at(longitude, time_zone) if at is None else options.parse_date(at, "--at")
    texts, conditions = list(quantity or ()), list(when or ())
    preset = PRESETS.get(purpose or "")
    if preset is not None:
        texts, conditions = [*preset.columns, *texts], [*preset.conditions, *conditions]
    columns = [column(text) for text in dict.fromkeys(texts or ["V@zenith", "illuminance"])]
    wanted = list({one.text: one for one in map(work.condition, conditions)}.values())

    config = load(climate, keys.chosen()[0])
    where = latitude, longitude, time_zone, config.observer.altitude_km

    def moment(text: str) -> dt.datetime:
        return moment_of(text, *where).astimezone(marks[0].time.tzinfo)  # type: ignore[union-attr]

    noon = "solar noon"
    marks = [m for d in (day, day + dt.timedelta(days=1)) for m in twilight_times(d, *where) if m.event == noon]
    first = moment(start) if start else marks[0].time
    last = moment(stop) if stop else marks[1].time
    times = work.rows(first, last, work.step_of(step))  # type: ignore[arg-type]
    stem = output or Path("out") / f"{options.file_stem(config.name or config.climate.name, 'sky')}_timeline"
    if stem.suffix.lower() in WRITERS:
        paths = [stem]
    else:
        paths = [stem.with_name(f"{stem.name}{suffix}") for suffix in WRITERS]
    for path in paths:
        check_file(path)
        require(f"{path}: a timeline's file of this kind", *NEEDED.get(path.suffix.lower(), ()))
    stem.parent.mkdir(parents=True, exist_ok=True)
    needs = [item.needs for item in (*columns, *(c.column for c in wanted))]
    with progress_bar() as progress:
        config = with_ozone_of(config, times[0], latitude)
        field = field_for(config, needs, part_of(progress, 0.0, 0.5))
        if field.chosen:
            print(f"twilight: {field.chosen}", file=sys.stderr, flush=True)
        rest = part_of(progress, 0.5, 0.5)
        result = work.timeline(field, latitude, longitude, times, columns, wanted, time_zone, rest)
    about = f"{config.climate.name}, {latitude:g} {longitude:g}, {day.isoformat()}"
    for path in paths:
        WRITERS[path.suffix.lower()](result, path, about)
    _print(result)
    if preset is not None:
        print(preset.about)
    for path in paths:
        print(f"wrote {path}")


def _print(result: Any) -> None:
    rows = []
    for mark in result.marks:
        if mark.time is None:
            rows.append([mark.event, "the sun does not get there", f"{mark.elevation_deg:.2f}"])
        else:
            rows.append([mark.event, _clock(mark.time), f"{mark.elevation_deg:.2f}"])
    for outcome in result.outcomes:
        text = outcome.condition.text
        if outcome.sentence:
            rows.append([text, outcome.sentence, ""])
        for crossing in outcome.crossings:
            word = "from" if crossing.begins else "until"
            rows.append([text, f"{word} {_clock(crossing.time)}", f"{crossing.sun_elevation_deg:.2f}"])
    print_table(["what", "time", "sun elevation [deg]"], rows, right=(2,))


def _clock(time: Any) -> str:
    return str(time.isoformat(sep=" ", timespec="seconds"))
