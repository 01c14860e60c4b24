"""What is seen beside what was: python benchmarks/visibility.py [arcus | crescent | dawn]

arcus: the arcus visionis of Sirius, Venus and Saturn, the least vertical distance between an object on the true horizon
and the sun below it with which the object is seen on that day at some altitude (visibility_arcus.csv).
crescent: the young moon beside the criteria of Yallop 1997 (q) and Odeh 2004 (V) at Yallop's best time, over two years
of new moons at four places: magnitudes above the eye's limit then (visibility_crescent.csv, docs/crescent.png).
dawn: first light over a desert near Tubruq, mean of four months: twilight over the night and luminance towards the sun
over that to the side, beside the contrast that an eye sees of something large with an edge (visibility_dawn.csv).
"""

from __future__ import annotations

import datetime as dt
import sys
from pathlib import Path

import numpy as np
import results

from twilight.config import load
from twilight.engine.light import Moments
from twilight.engine.light_setup import field_for
from twilight.engine.visibility import NakedEye
from twilight.sky.ephemeris import sun_position
from twilight.sky.eye_limit import limiting_magnitude, threshold_contrast
from twilight.sky.night import Place
from twilight.sky.objects import tracks
from twilight.sky.quantities.catalogue import quantity

HERE = Path(__file__).parent
LIGHT = {"solver.quality": "draft", "wavelengths.list_nm": [440.0, 500.0, 550.0, 600.0, 660.0]}
PLACES = {"Athens": (38.0, 23.7), "Cape Town": (-33.9, 18.4), "Islamabad": (33.7, 73.1), "Quito": (-0.2, -78.5)}
TUBRUQ = (32.08, 23.98)
DAWN_SUNS = (-18.0, -17.0, -16.0, -15.0, -14.7, -14.0, -13.1, -12.0)
"""-13.1: mean of 623 mornings, -14.7: the earliest (Hassan & Abdel-Hadi 2015)."""
DAWN_DEG = 3.0
BEST_TIME = 4.0 / 9.0
"""Yallop's best time: sunset plus 4/9 of the lag to moonset."""
OBJECTS = (
    # name, magnitude, azimuth from the sun when both are low [deg], what was found
    ("Sirius, Egypt", -1.46, 45.0, "in use 9 to 10"),
    ("Venus, morning or evening", -4.0, 5.0, "de Jong 6.1 to 8.6; Schoch 5.2 to 6.0; Ptolemy 5"),
    ("Saturn, morning", 0.6, 5.0, "Schoch 13; Ptolemy 11"),
    ("Saturn, evening", 0.6, 5.0, "Schoch 10; Ptolemy 11"),
)


def eye_in(climate: str) -> NakedEye:
    return NakedEye(field_for(load(climate, LIGHT), [quantity("luminance")]))


def arcus() -> None:
    rows = []
    heights, arcs = np.arange(1.0, 9.0), np.arange(3.0, 18.0)
    suns = (heights - arcs[:, None]).ravel()
    place = Place(30.0, 31.2, dt.datetime(2026, 7, 20, 2, tzinfo=dt.UTC))
    moments = Moments((place,) * suns.size, suns, np.zeros(suns.size), np.ones(suns.size))
    for climate in ("continental-clean", "continental-average"):
        eye = eye_in(climate)
        shown, lost = eye.seen_at(heights)
        up = np.tile(shown, arcs.size)[:, None]
        sky = {
            away: eye.background(moments, up, np.full(up.shape, away), moonlight=False).reshape(arcs.size, heights.size)
            for away in dict.fromkeys(row[2] for row in OBJECTS)
        }  # fmt: skip
        for factor in (1.4, 2.0):
            for name, magnitude, away, found in OBJECTS:
                margin = (limiting_magnitude(sky[away], factor) - lost - magnitude).max(axis=1)
                least = f"{np.interp(0.0, margin, arcs):.1f}" if margin[0] < 0.0 < margin[-1] else f"below {arcs[0]:g}"
                rows.append((name, climate, f"{factor:g}", f"{magnitude:g}", least, found))
    columns = ("object", "climate", "field_factor", "magnitude", "arcus_visionis_deg", "historical_deg")
    notes = [
        "Sirius: IMCCE, Heliacal rising of Sirius; Schoch's values in use for Babylonian diaries;",
        "de Jong 2019 (AHES, footnote 9); Ptolemy: Almagest XIII 7",
    ]
    results.write(HERE / "visibility_arcus.csv", columns, rows, notes=notes)


def yallop(arcv: float, width_arcmin: float) -> float:
    """q of Yallop 1997 (NAO Technical Note 69): A easily visible above .216, B above -.014, C, D with optical aid."""
    return (arcv - odeh_limit(width_arcmin, 11.8371)) / 10.0


def odeh(arcv: float, width_arcmin: float) -> float:
    """V of Odeh 2004 (Experimental Astronomy 18, 39): with the naked eye above 5.65, perhaps so above 2."""
    return arcv - odeh_limit(width_arcmin, 7.1651)


def odeh_limit(w: float, constant: float) -> float:
    return constant - 6.3226 * w + 0.7319 * w**2 - 0.1018 * w**3


def new_moons(first: dt.datetime, days: int) -> list[dt.datetime]:
    """Moments of the least elongation, to two hours."""
    moments = [first + dt.timedelta(hours=2 * k) for k in range(12 * days)]
    [moon] = tracks(["moon"], moments, 0.0, 0.0)
    phase = np.array([m.phase_angle_deg for m in moon.moons or ()])
    peaks = np.flatnonzero((phase[1:-1] > phase[:-2]) & (phase[1:-1] >= phase[2:]) & (phase[1:-1] > 160.0)) + 1
    kept: list[dt.datetime] = []
    for k in peaks:
        if not kept or (moments[k] - kept[-1]).days > 20:
            kept.append(moments[k])
    return kept


def crescent() -> None:
    rows, eye = [], eye_in("continental-clean")
    moons = new_moons(dt.datetime(2025, 1, 1, tzinfo=dt.UTC), 730)
    for place, (latitude, longitude) in PLACES.items():
        for new in moons:
            for day in range(4):
                found = evening(eye, latitude, longitude, new, day)
                if found is not None:
                    rows.append((place, *found))
    columns = ("place", "best_time_utc", "age_h", "arcv_deg", "width_arcmin", "q_yallop", "v_odeh", "margin_mag")
    q, margin = (np.array([float(row[k]) for row in rows]) for k in (5, 7))
    seen, easy, never = margin >= 0.0, q > 0.216, q < -0.16
    note = (
        f"computed as seen: {np.mean(seen[easy]):.0%} of {easy.sum()} with q > .216, {np.mean(seen[never]):.0%} of "
        f"{never.sum()} with q < -.160 (F = 2, continental-clean); margin 0 at q = {_zero(margin, q):.2f}"
    )
    print(note)
    results.write(HERE / "visibility_crescent.csv", columns, rows, notes=[note])
    draw(rows)


def _zero(margin: np.ndarray, q: np.ndarray) -> float:
    """q at which the margin is 0, by a line through those near it."""
    near = np.abs(margin) < 1.5
    return float(np.polyfit(margin[near], q[near], 1)[1])


def evening(eye: NakedEye, latitude: float, longitude: float, new: dt.datetime, day: int) -> tuple[str, ...] | None:
    """One evening: best time, age, the criteria and the margin; None where the moon sets before the sun."""
    noon = dt.datetime(new.year, new.month, new.day, 12, tzinfo=dt.UTC) - dt.timedelta(hours=longitude / 15.0)
    moments = [noon + dt.timedelta(days=day, minutes=2 * k) for k in range(300)]
    sun = np.asarray(sun_position(moments, latitude, longitude).elevation_deg)
    [moon] = tracks(["moon"], moments, latitude, longitude)
    sunset = int(np.argmax(sun < -0.83))
    moonset = int(np.argmax((moon.elevation_deg < -0.57) & (np.arange(300) > sunset - 30)))
    if moonset <= sunset or moon.elevation_deg[sunset] < 0.0:
        return None
    best = moments[sunset] + BEST_TIME * (moments[moonset] - moments[sunset])
    age = (best - new).total_seconds() / 3600.0
    if not 8.0 < age < 60.0:
        return None
    suns = sun_position([best], latitude, longitude)
    [here] = tracks(["moon"], [best], latitude, longitude)
    lune = (here.moons or ())[0]
    arcv = float(here.elevation_deg[0] - np.asarray(suns.elevation_deg)[0])
    away = np.radians(float(here.azimuth_deg[0] - np.asarray(suns.azimuth_deg)[0]))
    # geocentric difference of altitude: the parallax, which is all in altitude, back
    arcv_geocentric = arcv + np.degrees(np.arcsin(6378.14 / lune.distance_km)) * np.cos(
        np.radians(here.elevation_deg[0])
    )
    arcl = np.arccos(np.cos(np.radians(arcv)) * np.cos(away))
    width = 60.0 * lune.radius_deg * (1.0 - np.cos(arcl))
    margin = float(eye.margins([here], eye.moments(latitude, longitude, [best]))[0, 0])
    figures = (age, arcv_geocentric, width, yallop(arcv_geocentric, width), odeh(arcv, width), margin)
    return (best.isoformat(timespec="minutes"), *(f"{x:.3f}" for x in figures))


def draw(rows: list[tuple[str, ...]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    for k, (name, column, lines) in enumerate((("q of Yallop 1997", 5, (-0.16, -0.014, 0.216)),
                                               ("V of Odeh 2004", 6, (-0.96, 2.0, 5.65)))):  # fmt: skip
        axes = figure.add_subplot(1, 2, k + 1)
        for place in PLACES:
            part = [row for row in rows if row[0] == place]
            axes.plot([float(r[column]) for r in part], [float(r[7]) for r in part], ".", label=place)
        for x in lines:
            axes.axvline(x, color="0.6", linewidth=0.8)
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set_xlabel(name)
        axes.set_ylabel("crescent above the eye's limit [mag]")
        axes.set_ylim(-4.5, 6.0)
        axes.set_xlim(*((-1.0, 1.2), (-6.0, 16.0))[k])
    axes.legend(fontsize=8)
    figure.savefig(HERE.parent / "docs" / "crescent.png", dpi=130)


def dawn() -> None:
    """Luminance DAWN_DEG high at the sun's azimuth, and 40 deg to its side."""
    eye, found = eye_in("desert"), []
    for month in (1, 4, 7, 10):
        times = [dt.datetime(2026, month, 15, tzinfo=dt.UTC) + dt.timedelta(minutes=k) for k in range(360)]
        near = [int(np.argmin(np.abs(np.asarray(sun_position(times, *TUBRUQ).elevation_deg) - x))) for x in DAWN_SUNS]
        moments = eye.moments(*TUBRUQ, [times[k] for k in near])
        moments = moments._replace(sun_elevation_deg=np.array(DAWN_SUNS))
        azimuth = moments.sun_azimuth_deg[:, None] + np.array([0.0, 40.0])
        high = np.full(azimuth.shape, DAWN_DEG)
        all_light = eye.background(moments, high, azimuth, moonlight=False)
        night = eye.background(
            moments._replace(sun_elevation_deg=np.full(len(near), -40.0)), high, azimuth, moonlight=False
        )
        found.append((all_light[:, 0] / night[:, 0] - 1.0, all_light[:, 0] / all_light[:, 1] - 1.0, all_light[:, 1]))
    over_night, contrast, beside = np.mean(found, axis=0)
    least = threshold_contrast(1.0, beside, 1.0)
    columns = ("sun_deg", "twilight_over_night", "contrast_to_the_side", "threshold_contrast", "field_factor")
    rows = [(f"{sun:g}", *(f"{x:.3g}" for x in row)) for sun, *row in
            zip(DAWN_SUNS, over_night, contrast, least, contrast / least, strict=True)]  # fmt: skip
    notes = [f"desert, {DAWN_DEG:g} deg high; threshold of Crumey 2014 with F = 1; field_factor that would reach it"]
    results.write(HERE / "visibility_dawn.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["arcus", "crescent", "dawn"]
    for name in chosen:
        {"arcus": arcus, "crescent": crescent, "dawn": dawn}[name]()
