"""Why the zenith at one dark site wanders from quarter to quarter: ozone, the stratosphere, or the meter.

    python benchmarks/photometry_quarters.py measure FOLDER     writes photometry/quarters_measured.csv
    python benchmarks/photometry_quarters.py                    writes photometry/quarters.csv, photometry_quarters.png

FOLDER: DSNdata/BOX_ANALYSIS of a checkout of github soazcomms/soazcomms.github.io (MIT licence; at commit e7862f3e it
begins in July 2018, and the file of 2023 was not at hand): the readings of DSN035-S, Cosmic Campground.  A twilight
counts where the moon is below -8 deg, the zenith brightens from reading to reading towards the sun, and is not in the
brightest fourth of its quarter of the year (clouds); medians by quarter.  Nights: sun below -20 deg, moon below -12
deg, by hour of sidereal time.

What ozone explains is the column of the quarter's days after McPeters et al. 2007, times the computed slope.  Years
that are brighter than others in the same quarter are explained neither by the season nor by its ozone; `night_mag` says
whether their nights were brighter too.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.measured.ozone import climatological_column_du
from twilight.config import load
from twilight.studies.validate.measured.meter import SkyQualityMeter, site_of
from twilight.studies.validate.measured.photometry import Photometer
from twilight.studies.validate.measured.references import METER_FLOOR_MAG, METER_SITE

HERE = Path(__file__).parent
MEASURED = HERE / "photometry" / "quarters_measured.csv"
SUNS_DEG = (-5.0, -6.0, -7.0, -8.0, -9.0, -10.0)
OZONE_DU = (285.0, 330.0)
LEAST_TWILIGHTS = 20
"""A quarter of a year with fewer clear twilights is left out; our choice."""
LEAST_READINGS = 20
"""An hour of sidereal time with fewer readings in a quarter of a year is left out; our choice."""
HOURS_WEST = 7.26
"""From UTC to the sun's time at the site."""


def measure(folder: Path) -> None:
    """Medians by quarter from the network's files."""
    import pandas

    read = [pandas.read_csv(f) for f in sorted(folder.glob("DSN035-S_[0-9]*.csv")) if f.stat().st_size > 0]
    data = pandas.concat(read)
    data["time"] = pandas.to_datetime(data.UTC).dt.tz_localize(None) - pandas.Timedelta(hours=HOURS_WEST)
    data = data.drop_duplicates("time")
    data = data[data.SQM > 0]
    dusk = data[(data.moonalt < -8) & (data.sunalt > -13) & (data.sunalt < -3)]
    rows = []
    for (day, _), part in dusk.groupby([dusk.time.dt.date, dusk.time.dt.hour >= 12]):
        part = part.sort_values("sunalt")
        sun, mag = part.sunalt.to_numpy(), part.SQM.to_numpy()
        covered = sun.size > 3 and sun[0] <= SUNS_DEG[-1] and sun[-1] >= SUNS_DEG[0]
        if covered and np.all(np.diff(mag) < 0) and np.all(np.diff(sun) < 2.2):
            rows.append([pandas.Timestamp(day), *np.interp(SUNS_DEG, sun, mag)])
    twilights = pandas.DataFrame(rows, columns=["day", *SUNS_DEG])
    twilights["quarter"] = twilights.day.dt.to_period("Q")
    twilights["mean"] = twilights[list(SUNS_DEG)].mean(axis=1)
    twilights = twilights[twilights.groupby("quarter")["mean"].rank(pct=True) > 0.25]
    nights = night_offsets(data)
    out = []
    for quarter, part in twilights.groupby("quarter"):
        if len(part) >= LEAST_TWILIGHTS:
            ozone = np.mean([climatological_column_du(METER_SITE.latitude_deg, d.day_of_year) for d in part.day])
            mags = (f"{part[sun].median():.3f}" for sun in SUNS_DEG)
            out.append([quarter, len(part), f"{ozone:.1f}", *mags, f"{nights.get(quarter, np.nan):+.3f}"])
    columns = ["quarter", "twilights", "ozone_climatology_du", *(f"mag_at_{sun:g}" for sun in SUNS_DEG), "night_mag"]
    notes = (
        "zenith at Cosmic Campground, mag arcsec^-2 in the meter's band, medians by quarter of a year; readings of the",
        "Dark Sky Network of southern Arizona (github soazcomms/soazcomms.github.io, commit e7862f3e, MIT licence);",
        "ozone of the twilights' days after McPeters et al. 2007; night_mag: nights less that quarter of all years",
    )
    results.write(MEASURED, columns, out, notes=notes)


def night_offsets(data) -> dict:
    """By quarter: how much darker moonless nights are than that quarter in all years, at the same sidereal hour."""
    dark = data[(data.moonalt < -12) & (data.sunalt < -20)].copy()
    dark["quarter"], dark["hour"] = dark.time.dt.to_period("Q"), dark.LST.astype(int)
    found = dark.groupby(["quarter", "hour"]).SQM.agg(["size", "median"]).reset_index()
    found = found[found["size"] >= LEAST_READINGS]
    found["season"] = [quarter.quarter for quarter in found.quarter]
    found["off"] = found["median"] - found.groupby(["season", "hour"])["median"].transform("mean")
    return dict(found.groupby("quarter").off.mean())


def computed() -> np.ndarray:
    """(3, S): zenith [mag], its change per DU, and that from SAGE's low to its elevated stratosphere."""
    chosen = {"night": {}, "solver.quality": "draft"}
    none = chosen | {"aerosol.stratosphere": "none"}
    cases = [(chosen, du) for du in OZONE_DU]
    cases += [(none | {"stratosphere": {"kind": f"nh_midlat_{load_}"}}, OZONE_DU[0]) for load_ in ("low", "elevated")]
    mags = []
    for settings, column in cases:
        config = site_of(load("continental-average", settings))
        ozone = config.climate.gases.ozone.model_copy(update={"column_du": column})
        gases = config.climate.gases.model_copy(update={"ozone": ozone})
        config = config.model_copy(update={"climate": config.climate.model_copy(update={"gases": gases})})
        meter = SkyQualityMeter(Photometer(config, None, METER_SITE.altitude_km), METER_FLOOR_MAG)
        mags.append([meter.twilight_mag(sun) for sun in SUNS_DEG])
        print(settings, column, np.round(mags[-1], 3), flush=True)
    base, more, low, elevated = np.array(mags)
    return np.array([base, (more - base) / (OZONE_DU[1] - OZONE_DU[0]), elevated - low])


def fitted(y: np.ndarray, x: np.ndarray) -> tuple[float, float, float]:
    """Slope of y over x, its standard error, and the part of the variance of y that it explains."""
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    return slope, float(np.sqrt(left @ left / (y.size - 2) / (x @ x))), float(1.0 - left @ left / (y @ y))


def compare() -> None:
    with open(MEASURED, encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    names = [row["quarter"] for row in rows]
    ozone, night = (np.array([float(row[key]) for row in rows]) for key in ("ozone_climatology_du", "night_mag"))
    mags = np.array([[float(row[f"mag_at_{sun:g}"]) for sun in SUNS_DEG] for row in rows])
    off = mags - mags.mean(axis=0)
    _, per_du, load_mag = computed()
    by_ozone = np.outer(ozone - ozone.mean(), per_du)
    mean, expected = off.mean(axis=1), by_ozone.mean(axis=1)
    out = []

    def say(what: str, value: float, error: float | None = None, unit: str = "1") -> None:
        out.append([what, f"{value:.4g}", "" if error is None else f"{error:.2g}", unit])
        print(*out[-1], flush=True)

    say("wander, least", mean.min(), unit="mag")
    say("wander, largest", mean.max(), unit="mag")
    say("its standard deviation", mean.std(), unit="mag")
    slope, error, part = fitted(mean, ozone)
    say("slope over the season's ozone, measured", slope, error, "mag/DU")
    say("slope over ozone, computed", per_du.mean(), unit="mag/DU")
    say("variance explained by the season's ozone, slope free", part)
    say("variance explained by the season's ozone, slope computed", 1.0 - np.var(mean - expected) / np.var(mean))
    # within one quarter of the year the season's ozone is the same: what is left is by year
    season = np.array([name[-1] for name in names])
    by_season = np.array([mean[season == s].mean() for s in season])
    by_year = mean - by_season
    say("variance that is by quarter of the year", 1.0 - np.var(by_year) / np.var(mean))
    known = np.isfinite(night)
    slope, error, part = fitted(by_year[known], night[known])
    say("year to year, slope over that of the nights", slope, error)
    say("year to year, variance explained by that of the nights", part)
    # shapes: a zero is the same under all suns, a stratosphere is not
    left = off - by_ozone
    shapes = np.stack([np.ones(len(SUNS_DEG)), load_mag], axis=1)
    coefficient = np.linalg.lstsq(shapes, left.T, rcond=None)[0].T
    zero = left.mean(axis=1)
    say("variance under all suns that ozone explains", 1.0 - np.var(left) / np.var(off))
    say("the same with a zero for each quarter", 1.0 - np.var(left - zero[:, None]) / np.var(off))
    say(
        "the same with a zero and a stratosphere for each quarter",
        1.0 - np.var(left - coefficient @ shapes.T) / np.var(off),
    )
    residual = left - coefficient @ shapes.T
    scatter = np.sum(residual**2) / (residual.size - coefficient.size)
    error = float(np.sqrt(scatter * np.linalg.inv(shapes.T @ shapes)[1, 1]))
    for name, load_ in zip(names, coefficient[:, 1], strict=True):
        say(f"stratosphere that this takes in {name}, low to elevated being 1", load_, error)
    say("low to elevated at -5 deg", load_mag[0], unit="mag")
    say("low to elevated at -10 deg", load_mag[-1], unit="mag")
    results.write(HERE / "photometry" / "quarters.csv", ("what", "value", "standard_error", "unit"), out)
    draw(names, ozone, mean, expected, by_year, night)


def draw(names, ozone, mean, expected, by_year, night) -> None:
    from matplotlib import pyplot

    figure, (top, left, right) = pyplot.subplots(
        1, 3, figsize=(15, 4.4), layout="constrained", gridspec_kw={"width_ratios": [2, 1, 1]}
    )
    when = np.array([int(name[:4]) + (int(name[-1]) - 0.5) / 4.0 for name in names])
    top.plot(when, mean, "ks", ms=4, label="measured, mean of -5 to -10 deg")
    top.plot(when, expected, "C1o-", ms=3, lw=1, label="computed from the season's ozone")
    top.plot(when, night, "C0^", ms=4, label="nights, less the same season of other years")
    top.set(xlabel="year", ylabel="zenith, darker is up [mag]")
    top.legend(fontsize=8)
    left.plot(ozone, mean, "ks", ms=4)
    order = np.argsort(ozone)
    left.plot(ozone[order], expected[order], "C1", label="computed slope")
    left.set(xlabel="ozone of the season [DU]", ylabel="twilight [mag]")
    left.legend(fontsize=8)
    right.plot(night, by_year, "ks", ms=4)
    span = np.array([np.nanmin(night), np.nanmax(night)])
    right.plot(span, span, "C0", label="a meter's zero")
    right.set(xlabel="nights [mag]", ylabel="twilight, less the same season of other years [mag]")
    right.legend(fontsize=8)
    for axis in (top, left, right):
        axis.grid(alpha=0.3)
        axis.axhline(0, color="0.5", lw=0.8)
    figure.savefig(HERE / "photometry_quarters.png", dpi=100)


if __name__ == "__main__":
    if sys.argv[1:2] == ["measure"]:
        measure(Path(sys.argv[2]))
    else:
        compare()
