"""Figures in README and docs, written from the tables here: each stands on one page, between two marks.

    python benchmarks/pages.py

`tests/project/test_docs.py` fails where a page says something else than its table.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import results

SUNS = {"30 to -6 deg": range(-6, 31), "-9 and -12": range(-12, -8), "-18": range(-18, -17)}
"""Columns of the table of errors: ranges of the true elevation of the sun [deg]."""
CASES = {
    "preview": "the preview of a first sky, until it is there",
    "zones, fresh machine": "a first sky, kernels compiled on the way",
    "zones, compiled": "a first sky of some air, compiled before",
    "zones, compiled, field cached": "another sky of the same air and suns, from the cache",
    "compact, fresh machine": "a first sky with `--solver compact`, which compiles nothing",
}
"""Cases of cold_start.csv and what a reader calls them; whole commands, with Python's start and the files written."""


def _rows(name: str) -> list[dict[str, Any]]:
    return results.read_rows(results.FOLDER / name)


def largest_errors(quality: str) -> dict[str, list[float]]:
    """Climate to the largest error [%] of each range of suns, in the order of `zones_error.csv`."""
    found: dict[str, list[float]] = {}
    for row in _rows("zones_error.csv"):
        if row["quality"] == quality:
            errors = found.setdefault(row["climate"], [0.0] * len(SUNS))
            for i, suns in enumerate(SUNS.values()):
                if int(row["sun_elevation_deg"]) in suns:
                    errors[i] = max(errors[i], float(row["excess_percent"]))
    return found


def errors() -> str:
    """Errors of `zones` in all climates."""
    standard, draft = largest_errors("standard"), largest_errors("draft")
    head = [f"`{quality}`, {suns}" for quality in ("standard", "draft") for suns in SUNS]
    lines = ["|climate|" + "|".join(head) + "|", "|---|" + "---|" * len(head)]
    for climate in draft:
        row = [f"{v:.1f}" for v in standard[climate]] if climate in standard else ["not renewed"] * len(SUNS)
        lines.append(f"|`{climate}`|" + "|".join([*row, *(f"{value:.1f}" for value in draft[climate])]) + "|")
    return "\n".join(lines)


def processor_s() -> dict[str, float]:
    """Case of cold_start.csv to the processor time [s] of this program."""
    rows = [row for row in _rows("cold_start.csv") if row["program"] == "this program"]
    return {row["case"]: float(row["processor_s"]) for row in rows}


def times() -> str:
    """Processor time of whole commands."""
    took = processor_s()
    return "\n".join(
        ["|what|processor time [s]|", "|---|---|"] + [f"|{says}|{took[case]:.0f}|" for case, says in CASES.items()]
    )


def left_out() -> str:
    """What `zones` is off by without one thing, and the processor time that this saves."""
    rows = _rows("ablations.csv")
    whole_s = float(rows[0]["cpu_without_s"])
    lines = [f"|without|median|95 %|saves of {whole_s:.1f} s|", "|---|---|---|---|"]
    for row in rows:
        saved = max(0.0, float(row["cpu_without_s"]) - float(row["cpu_s"]))
        lines.append(f"|{row['ablation']}|{row['median_percent']}|{row['p95_percent']}|{saved:.1f}|")
    return "\n".join(lines)


def budget() -> str:
    """Haber's method from the published system to the field: median/95 % of the error of each step and sun."""
    found: dict[str, dict[str, str]] = {}
    seconds: dict[str, str] = {}
    for row in _rows("haber_budget.csv"):
        percent = (float(row[name]) for name in ("median_percent", "p95_percent"))
        off = "/".join(f"{value:.0f}" if value >= 10.0 else f"{value:.2g}" for value in percent)
        found.setdefault(row["step"], {})[row["sun_elevation_deg"]] = off
        seconds[row["step"]] = f"{float(row['processor_s']):.2g}"
    suns = list(next(iter(found.values())))
    lines = ["|step|" + "|".join(f"{float(sun):+g}" for sun in suns) + "|s|", "|---" * (len(suns) + 2) + "|"]
    for step, of_suns in found.items():
        lines.append(f"|{step}|" + "|".join(of_suns.get(sun, "") for sun in suns) + f"|{seconds[step]}|")
    return "\n".join(lines)


def in_short() -> str:
    """One error and one time."""
    worst = max(largest_errors("standard")["continental-average"])
    took = processor_s()
    return (
        "**How wrong**: 95 % of what a file holds is within 0.5 % of the field that was solved, and in 26 directions\n"
        f"from 1 deg up 95 % of the field within {worst:.1f} % of a Monte-Carlo reference, sun from +30 to -18 deg\n"
        "(continental air; [other air](docs/accuracy.md)).\n\n"
        f"**How fast**: a sky takes {took['zones, compiled']:.0f} s of processor time; the first one on a machine\n"
        f"{took['zones, fresh machine']:.0f} s, most of it compiling, with a preview after {took['preview']:.1f} s."
    )


def _zenith(name: str) -> str:
    """Least and largest factor of a site's zenith, sun from 0 to -15 deg."""
    return _range(
        row["factor"] for row in _rows("photometry/levels.csv") if (row["climate"], row["site"]) == (AIR, name)
    )


def _range(values: Iterable[str | float]) -> str:
    """Least to largest."""
    numbers = sorted(float(value) for value in values)
    return f"{numbers[0]:.2f} to {numbers[-1]:.2f}"


AIR = "continental-average"
"""The climate beside which photometers stand."""


def measured_sets() -> str:
    """Every measurement of real skies beside what is computed by default."""
    levels = [row for row in _rows("photometry/levels.csv") if row["climate"] == AIR]
    points = [row for row in _rows("photometry/points.csv") if row["climate"] == AIR]
    meter = [
        10.0 ** float(row["log10_ratio"])
        for row in points
        if row["quantity"].startswith("zenith, meter") and -12.0 <= float(row["sun_elevation_deg"]) <= -4.0
    ]
    moonlit = [
        10.0 ** (-0.4 * float(row["difference_mag"]))
        for row in _rows("moonlight.csv")
        if float(row["phase_deg"]) <= 90.0 and float(row["moon_altitude_deg"]) < 45.0 and int(row["readings"]) >= 50
    ]
    evenings = [
        row for row in _rows("red_twilight_fits.csv") if row["horizon"] == "typical" and row["session"] != "all"
    ]
    red, blue = ("/".join(row[f"{c}_over_recorded_median"] for row in evenings) for c in ("red", "blue"))
    deep = next(row for row in _rows("deep_twilight.csv") if row["case"] == "typical, the site's ozone")
    told = {row["case"]: row for row in _rows("deep_contrast.csv")}
    contrast = "/".join(
        f"{float(told['mountain'][f'{nm}_nm']) / float(told['measured'][f'{nm}_nm']):.2f}" for nm in (450, 540, 600)
    )

    def boss(*nm: int) -> str:
        return "/".join(f"{float(deep[f'{w}_nm']):.2f}" for w in nm)

    illuminance = _range(row["factor"] for row in levels if row["quantity"] == "illuminance")
    rows = (
        ("*levels*", "", "", ""),
        ("illuminance of level ground", "+60 to -18", "many sites", illuminance),
        ("luminance of the zenith", "0 to -15", "Maryland, 30 m", _zenith("Maryland")),
        ("", "", "Sacramento Peak, 2.8 km", _zenith("Sacramento Peak")),
        ("zenith, meter's band", "-4 to -12", "Cosmic Campground, 1.6 km; zero to 10 %", _range(meter)),
        ("the same by moonlight", "moon below 45", "the same, clear quarter of the nights", _range(moonlit)),
        ("*colours, shapes*", "", "", ""),
        ("level ground, 650/550 nm", "0 to -6", "three rural evenings, of which `typical` was made", red),
        ("450/550 nm", "", "", blue),
        ("zenith, 420/450/530 over 500 nm", "-14 less -16", "Apache Point, 2.8 km, BOSS", boss(420, 450, 530)),
        ("600/650", "", "", boss(600, 650)),
        ("700/800/850", "", "", boss(700, 800, 850)),
        (
            "towards over away from the sun, blue/green/red",
            "-14",
            "Chile, 2.7 km, all-sky camera; `mountain`, its haze fitted",
            contrast,
        ),
    )
    head = ["|quantity|sun [deg]|where, how well|computed over measured|", "|---|---|---|---|"]
    return "\n".join(head + ["|" + "|".join(row) + "|" for row in rows])


PARTS = {
    "docs/how-true.md": {"measured sets": measured_sets},
    "docs/accuracy.md": {"errors of zones": errors, "times": times},
    "docs/three-papers.md": {"error budget": budget, "what leaving out costs": left_out},
    "README.md": {"in short": in_short},
}


def filled(page: str) -> str:
    """The text of a page with what its tables say now."""
    text = (results.ROOT / page).read_text(encoding="utf-8")
    for name, part in PARTS[page].items():
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        head, _, rest = text.partition(begin)
        text = f"{head}{begin}\n\n{part()}\n\n{end}{rest.partition(end)[2]}"
    return text


if __name__ == "__main__":
    results.say_help(__doc__)
    for page in PARTS:
        (results.ROOT / page).write_text(filled(page), encoding="utf-8")
