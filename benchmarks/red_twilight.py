"""Screens beyond the horizon that `twilight validate spectra` fits to recorded spectra of level ground, calibration
fixed and free, from +5 to -8 deg: python benchmarks/red_twilight.py writes red_twilight_fits.csv and the figure of
docs/notes/red-twilight.md."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config import load
from twilight.studies.validate.measured import spectra as recorded
from twilight.studies.validate.measured.spectra_report import draw

HERE = Path(__file__).parent
SESSIONS = (3, 4)


def main() -> None:
    file = HERE / ".." / ".." / "shared" / "data" / "rural_twilight_spectra" / "sessions_2_3_4.csv"
    series = {str(s): recorded.at_nodes(recorded.read_spectra(file, str(s)), 5.0, -8.0) for s in SESSIONS}
    config, rows, fits = load("continental-average", {"solver.quality": "draft"}), [], {}
    suns = np.unique(np.concatenate([one.sun_deg for one in series.values()]))[::-1]
    every = replace(series[str(SESSIONS[0])], sun_deg=suns)
    (basis,) = recorded.bases(config, every, (300.0,))
    for session, one in series.items():
        k = [int(np.flatnonzero(suns == sun)[0]) for sun in one.sun_deg]
        here = replace(basis, ground=basis.ground[:, k], zenith=basis.zenith[:, k])
        for free, most in itertools.product((False, True), (0.1, np.inf)):
            found = fits[session, free, most] = recorded.fit(one, here, most, free)
            green, low = int(np.flatnonzero(one.wavelength_nm == 550.0)[0]), one.sun_deg <= 0.0
            off = np.exp(found.log_ratio - found.log_ratio[:, green : green + 1])
            ranges = [f"{off[low, w].min():.2f} to {off[low, w].max():.2f}" for w in (2, 7)]
            factor = found.calibration / found.calibration[green]
            rows.append([session, "free" if free else "as recorded", "any" if np.isinf(most) else f"{most:g}",
                         f"{100 * found.rms:.1f}", *ranges, f"{found.zenith_mag[one.sun_deg <= -4].max():.2f}",
                         *(f"{x:.2f}" for x in found.clouds), f"{factor[0]:.2f}", f"{factor[7]:.2f}"])  # fmt: skip
            print(*rows[-1], flush=True)
    draw(
        series["4"], fits["4", True, 0.1], HERE / "red_twilight_session_4.png", "session 4, a factor by wavelength free"
    )
    columns = ("session", "calibration", "zenith_mag_allowed", "rms_percent", "blue_over_recorded", "red_over_recorded",
               "zenith_mag", "cover", "top_km", "top_spread_km", "factor_400", "factor_650")  # fmt: skip
    notes = (
        "screens from 300 km on, fitted to colours from +5 to -8 deg; ranges from 0 to -8; factors are over 550 nm",
    )
    results.write(HERE / "red_twilight_fits.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    main()
