"""`twilight climate from`: the climate of a place and date from files of measurements."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import with_errors_as_sentences

app = typer.Typer(name="climate", help="Make climates.", no_args_is_help=True, rich_markup_mode=None)


def from_files(
    moment: options.PlaceAndTime,
    files: Annotated[
        list[Path] | None, argument("FILE...", "Soundings, reanalyses, AERONET: known by what they hold.")
    ] = None,
    base: Annotated[
        str, option("CLIMATE", "Gives what the files do not.", complete=options.climate_names)
    ] = "continental-average",
    name: Annotated[str | None, option("NAME", "Of the climate; without it, the base's with the date.")] = None,
    settings: Annotated[list[str] | None, option("KEY=VALUE", "Any key of the base; may be repeated.", "--set")] = None,
) -> None:
    """Print a climate in YAML with the air that files hold at a place and time, and say what is from where."""
    import yaml

    from twilight.config import load_climate
    from twilight.config.measured import assemble, read

    if not files:
        raise TwilightError("climate from: needs a file")
    wanted = _wanted(moment)
    climate = load_climate(base, *options.settings_of(settings))
    readings = [read(str(path), wanted) for path in files]
    data = assemble(climate, readings, wanted)
    date = f"-{wanted.time:%Y-%m-%d}" if wanted.time is not None else ""
    data["name"] = name or f"{climate.name}{date}"
    where = "" if wanted.latitude_deg is None else f" at {wanted.latitude_deg:g} N {wanted.longitude_deg:g} E"
    data["description"] = f"The air of {climate.name} with that of files{where}{date and f' on {date[1:]}'}"
    for words in source_lines(data["air"]["sources"]):
        print(f"twilight: {words}", file=sys.stderr)

    class Whole(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            """Climates have no aliases: what comes twice is written twice."""
            return True

    print(yaml.dump(data, None, Whole, sort_keys=False, default_flow_style=None, width=118, allow_unicode=True), end="")


def source_lines(sources: dict[str, str]) -> list[str]:
    """A line for each part of the air: where it is from."""
    return [f"{name}: {words}" for name, words in sources.items()]


def source_summary(sources: dict[str, str]) -> str:
    """Which parts of the air are from files, and which are the climate's own."""
    of: dict[bool, list[str]] = {True: [], False: []}
    for name, words in sources.items():
        if name != "not used":
            of[words.startswith("the climate's own")].append(name)
    return f"air from files: {', '.join(of[False]) or 'nothing'}; the climate's own: {', '.join(of[True]) or 'nothing'}"


def _wanted(moment: options.PlaceAndTime) -> Any:
    """The place and time of the options."""
    from twilight.io.air import PlaceAndTime

    if moment.at is None:
        if (moment.latitude is None) != (moment.longitude is None):
            raise TwilightError("--latitude and --longitude: give both, or neither")
        return PlaceAndTime(None, moment.latitude, moment.longitude)
    sun = moment.sun()
    assert sun is not None
    return PlaceAndTime(sun.aware(sun.at), moment.latitude, moment.longitude)


app.command("from")(with_errors_as_sentences(from_files))
