"""Moonlit nights against a dark site's meter: python benchmarks/moonlight.py ../shared/data/dark_sky_network

Zenith brightness by the moon's phase and altitude (Cosmic Campground, New Mexico, 1634 m; 75th percentile, which is the
clear side) beside the computed one: the meter's band (SQM, AB) less the difference of that band's magnitude and V for
the clear night sky, by which such meters are set, with the site's moonless 21.92 added; in V; and by Krisciunas and
Schaefer 1991 (extinction .172 mag).  `stray`: response of the meter to the moon itself, over that to its axis, that
would explain the difference: the field of these meters has wings (Bartolomei et al. 2021, Sensors 21, 7544).
Writes moonlight.csv and docs/moonlight.png.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import results

from twilight.base.whole_files import save_figure
from twilight.config import load
from twilight.engine import solve
from twilight.numerics import spectrum
from twilight.scene.scene import resolve
from twilight.sky.moon import Moon, moon_illuminance_lux
from twilight.sky.quantities.measure import Spectra

SITE_KM = 1.634
MOONLESS_MAG = 21.92
METER_FIELD_SR = 0.138
"""Solid angle of the meter's field: 1.13 x (20 deg)^2, of a Gauss curve of that width."""
COLUMNS = (
    "phase_deg", "moon_altitude_deg", "readings", "measured_p75_mag", "computed_sqm_mag", "difference_mag",
    "computed_v_mag", "krisciunas_schaefer_1991_mag", "stray",
)  # fmt: skip


def interval(text: str) -> tuple[float, float]:
    low, high = text.strip("(]").split(",")
    return float(low), float(high)


def krisciunas_schaefer(phase_deg: float, altitude_deg: float, k: float = 0.172) -> float:
    """Moonlight in the zenith [nL], eq. 3, 15, 20 and 21."""
    intensity = 10.0 ** (-0.4 * (3.84 + 0.026 * phase_deg + 4e-9 * phase_deg**4))
    zenith = np.radians(90.0 - altitude_deg)
    scattered = 10.0**5.36 * (1.06 + np.cos(zenith) ** 2) + 10.0 ** (6.15 - (90.0 - altitude_deg) / 40.0)
    path = (1.0 - 0.96 * np.sin(zenith) ** 2) ** -0.5
    return scattered * intensity * 10.0 ** (-0.4 * k * path) * (1.0 - 10.0 ** (-0.4 * k))


def nl_of_mag(mag: float) -> float:
    return 34.08 * np.exp(20.7233 - 0.92104 * mag)


def main(folder: Path) -> None:
    settings = {"ground.altitude_km": SITE_KM, "gases.ozone.column_du": 285.0, "solver.quality": "draft",
                "wavelengths": {"min_nm": 380.0, "max_nm": 820.0, "count": 12}}  # fmt: skip
    scene = resolve(load("continental-average", settings))
    solved = solve(scene, cached=False)
    nm = scene.medium.wavelength_nm
    floor = 10.0 ** (-0.4 * MOONLESS_MAG)
    rows = []
    for row in csv.DictReader((folder / "zenith_moonlit_cosmic_campground.csv").open()):
        phases, heights = interval(row["phase_deg"]), interval(row["moon_alt_deg"])
        altitude, phase = 0.5 * sum(heights), 0.5 * sum(phases)
        sky = solved.radiance(altitude, [90.0], [0.0])[0]
        inside = np.linspace(max(phases[0], 1.55), phases[1], 7)[1::2]
        factor = np.mean([Moon(altitude, 180.0, g).irradiance_factor(nm) for g in inside], axis=0) * sky
        light = Spectra(factor, nm)
        # the meter's zero is that of V for a night sky, whose spectrum is about the sun's: V of the meter in sunlight
        flat = Spectra(np.ones(nm.size), nm)
        offset = float(flat.magnitude("V", "Vega") - flat.magnitude("SQM", "AB"))
        sqm = float(light.magnitude("SQM", "AB")) + offset
        v = float(light.magnitude("V", "Vega"))
        total, in_v = (-2.5 * np.log10(10.0 ** (-0.4 * m) + floor) for m in (sqm, v))
        k91 = krisciunas_schaefer(phase, altitude) + nl_of_mag(MOONLESS_MAG)
        measured = float(row["p75"])
        excess = 10.0 ** (-0.4 * measured) - 10.0 ** (-0.4 * total)
        beam = solved.direct(altitude).irradiance
        through = float(spectrum.integrate(beam, nm, spectrum.solar_at_visible() * _v()) / _in_v())
        lux = moon_illuminance_lux(Moon(altitude, 180.0, phase)) * through
        stray = excess * 10.8e4 * METER_FIELD_SR / lux
        rows.append((phase, altitude, int(row["n"]), measured, total, total - measured, in_v,
                     (20.7233 - np.log(k91 / 34.08)) / 0.92104, stray))  # fmt: skip
    chosen = np.array([r[5] for r in rows if r[0] <= 90.0 and r[1] < 45.0 and r[2] >= 50])
    note = (
        f"to 90 deg of phase, moon below 45 deg: {np.mean(np.abs(chosen) <= 0.2):.0%} of {chosen.size} within 0.2 mag, "
        f"mean {chosen.mean():+.2f}, rms {np.sqrt((chosen**2).mean()):.2f}, largest {np.abs(chosen).max():.2f}"
    )
    print(note)
    results.write(results.FOLDER / "moonlight.csv", COLUMNS, [[_cell(x) for x in r] for r in rows], notes=[note])
    draw(rows)


def _v() -> np.ndarray:
    return spectrum.colour_matching_functions("cie1931_2deg")[:, 1]


def _in_v() -> float:
    return float(spectrum.solar_at_visible() @ _v())


def _cell(x: float) -> str:
    return f"{x:.2g}" if abs(x) < 0.02 and x != 0 else f"{x:g}" if float(x).is_integer() else f"{x:.3f}"


def draw(rows: list[tuple]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = figure.add_subplot()
    for k, altitude in enumerate(sorted({r[1] for r in rows})):
        part = [r for r in rows if r[1] == altitude and r[2] >= 50]
        phase = [r[0] for r in part]
        axes.plot(phase, [r[3] for r in part], "o", color=f"C{k}", label=f"moon {altitude:g}° up, measured")
        axes.plot(phase, [r[4] for r in part], "-", color=f"C{k}")
        axes.plot(phase, [r[7] for r in part], ":", color=f"C{k}", linewidth=1.0)
    axes.invert_yaxis()
    axes.set_xlabel("phase angle of the moon [deg]")
    axes.set_ylabel("zenith [mag arcsec$^{-2}$]")
    axes.set_title("points measured, lines computed, dotted Krisciunas and Schaefer 1991", fontsize=10)
    axes.legend(fontsize=8)
    save_figure(results.ROOT / "docs" / "moonlight.png", figure, 130)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data/dark_sky_network"))
