"""Colours of level ground from day to dusk beside three recorded sessions: with a clean horizon, the preset `typical`,
the mean of the screens that fit the other two, and its own: python benchmarks/red_twilight.py [SPECTRA.csv] writes
red_twilight_fits.csv and the figure of docs/validation.md.

A recording is on the scale of its own day (`spectra.on_own_day`); session 3, which has no day, on that of the two
others.  Ratios are computed over recorded, of 650/550 and 450/550 nm, suns from 0 to -6 deg.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config import load
from twilight.studies.validate.measured import spectra as recorded
from twilight.studies.validate.measured.report import draw_spectra

HERE = Path(__file__).parent
FILE = HERE.parents[1] / "shared" / "data" / "rural_twilight_spectra" / "sessions_2_3_4.csv"
SESSIONS = ("2", "3", "4")
DUSK_DEG = (-6.0, 0.0)


def main() -> None:
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    series = {name: recorded.at_nodes(recorded.read_spectra(file, name), 30.0, -8.0) for name in SESSIONS}
    suns = np.unique(np.concatenate([one.sun_deg for one in series.values()]))[::-1]
    every = replace(series["3"], sun_deg=suns)
    (basis,) = recorded.bases(load("continental-average", {"solver.quality": "draft"}), every, (300.0,))
    nm = list(every.wavelength_nm)
    green, red, blue = (nm.index(w) for w in (550.0, 650.0, 450.0))
    on_day, factors = {}, []
    for name, one in series.items():
        k = [int(np.flatnonzero(suns == sun)[0]) for sun in one.sun_deg]
        here = replace(basis, ground=basis.ground[:, k], zenith=basis.zenith[:, k])
        light, (here,), factor = recorded.on_own_day(one, [here], 5.0)
        on_day[name] = (light, here, factor)
        factors += [] if factor is None else [factor]
    sensor = np.exp(np.mean(np.log(factors), axis=0))
    rows, off, fits = [], {}, {}
    for name, (light, here, factor) in on_day.items():
        if factor is None:
            light = replace(light, irradiance=light.irradiance / sensor)
        fits[name] = light, here, recorded.fit(light, here, 0.1)
        if name == "4":
            draw_spectra(
                *fits[name][::2],
                results.FOLDER / "red_twilight_session_4.png",
                "session 4, on the scale of its own day",
            )
    for name, (light, here, fitted) in fits.items():
        dusk = (light.sun_deg >= DUSK_DEG[0]) & (light.sun_deg <= DUSK_DEG[1])
        others = np.mean([fit.rises for other, (_, _, fit) in fits.items() if other != name], axis=0)
        for horizon, rises in (
            ("clean", np.eye(fitted.rises.size)[0]),
            ("typical", recorded.typical_rises()),
            ("of the other two", others),
            ("fitted", fitted.rises),
        ):
            computed = np.tensordot(rises, here.ground, 1)
            ratio = (computed / computed[:, [green]]) / (light.irradiance / light.irradiance[:, [green]])
            zenith = -2.5 * np.log10(rises @ here.zenith / here.zenith[0])[light.sun_deg <= -4.0].max()
            found = [ratio[dusk, w] for w in (red, blue)]
            off.setdefault(horizon, []).append(found)
            numbers = [f(one) for one in found for f in (np.median, np.min, np.max)]
            day = "its own" if on_day[name][2] is not None else "of sessions 2, 4"
            rows.append([name, day, horizon, *(f"{x:.2f}" for x in numbers), f"{zenith:.2f}"])
            print(*rows[-1], flush=True)
    for horizon, found in off.items():
        away = [np.median(np.abs(np.concatenate([one[w] for one in found]) - 1.0)) for w in (0, 1)]
        rows.append(["all", "", horizon, f"{away[0]:.2f}", "", "", f"{away[1]:.2f}", "", "", ""])
        print(*rows[-1], flush=True)
    kinds = itertools.product(("red", "blue"), ("median", "least", "most"))
    columns = ("session", "day", "horizon", *(f"{a}_over_recorded_{b}" for a, b in kinds), "zenith_mag")
    told = ", ".join(f"{f:.2f} at {w:g} nm" for f, w in zip(sensor / sensor[green], nm, strict=True))
    notes = ("computed over recorded, suns from 0 to -6 deg; rows all: median of the distance from 1",
             f"the sensor by day, over 550 nm: {told}")  # fmt: skip
    results.write(results.FOLDER / "red_twilight_fits.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
