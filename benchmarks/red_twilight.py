"""Why level ground is computed too red after sunset: what each candidate does to its colour, and to the zenith.

    python benchmarks/red_twilight.py      writes red_twilight.csv, red_twilight_screens, _place, _fits.csv

Colours are irradiance of level ground, sun and sky, at 450 and at 650 over that at 550 nm (means of three bins of 5 nm
where measured).  `over_session_N`: computed over measured.  `irradiance`: at 550 nm over that of the first case;
`zenith_mag`: by how much the zenith is fainter than there at 550 nm; `components`: least over largest component of the
zenith's polarised light at 550 nm from 2.8 km, sun at -3 deg (0.06 was measured there).
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import results
from scipy.optimize import differential_evolution

from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import Screen
from twilight.config.load import load as load_config
from twilight.config.load import load_climate
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones
from twilight.studies.validate.measured import spectra as recorded
from twilight.studies.validate.measured.photometry import disc_irradiance, hemisphere
from twilight.studies.validate.measured.references import level_ground_spectra
from twilight.studies.validate.measured.spectra_report import draw
from twilight.transport.beam import prepare_beam

HERE = Path(__file__).parent
NM = np.array([450.0, 550.0, 650.0])
SUNS_DEG = (0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0)
SESSIONS = (3, 4)
AIR = "continental-average"
COLUMNS = (
    *("case", "sun_deg", "i450_over_i550", "i650_over_i550"),
    *(f"{colour}_over_session_{session}" for session in SESSIONS for colour in ("blue", "red")),
    *("irradiance", "zenith_mag", "components"),
)
HIGH_KM = 2.8
WIDTH_KM = 0.5
"""Altitude over which a step of the basis of screens rises from 0 to 1."""
STEPS_KM = (4.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 14.0, 17.0, 21.0)

Response = Callable[[np.ndarray, np.ndarray], np.ndarray]


_SOLVED: dict[str, Any] = {}


def solved(medium: Medium, quality: str) -> Any:
    """The field and the sunbeam of a medium; those of the last one are held."""
    if _SOLVED.get("of") is not medium or _SOLVED.get("quality") != quality:
        field = zones.prepare(medium, zones.QUALITIES[quality], sun_elevations_deg=SUNS_DEG)
        _SOLVED.update(of=medium, quality=quality, made=(field, prepare_beam(medium)))
    return _SOLVED["made"]


class Light:
    """The light of one medium under all suns: level ground (S, W), zenith (S, W) and the ratio of its components."""

    def __init__(
        self, medium: Medium, quality: str = "draft", response: Response | None = None, altitude_km: float = 0.0
    ):
        field, beam = solved(medium, quality)
        ground, zenith = [], []
        for sun in SUNS_DEG:
            e, a, weight = hemisphere(sun)
            if response is not None:
                weight = weight * response(e, a)
            sky = weight @ field.radiance(sun, e, a, observer_altitude_km=altitude_km)
            direct = disc_irradiance(beam, medium, sun) if response is None and altitude_km == 0.0 else 0.0
            ground.append(sky + direct)
            zenith.append(field.radiance(sun, [90.0], [0.0])[0])
        factor = solar_irradiance(NM, "astm_g173_etr")
        self.ground, self.zenith = np.array(ground) * factor, np.array(zenith)
        i, q, u = field.stokes(-3.0, [90.0], [0.0], observer_altitude_km=HIGH_KM)[0][:, 1]
        polarised = float(np.hypot(q, u))
        self.components = (i - polarised) / (i + polarised)


def air(**settings: Any) -> Medium:
    """The climate with dotted keys changed (two underscores for a dot)."""
    climate = settings.pop("climate", AIR)
    return climate_medium(load_climate(climate, {k.replace("__", "."): v for k, v in settings.items()}), NM)


def measured(session: int) -> np.ndarray:
    """Measured blue and red over green (S, 2) at SUNS_DEG."""
    suns, nm, spectra = level_ground_spectra(session)
    found = np.stack([spectra[:, np.abs(nm - w) < 6.0].mean(axis=1) for w in NM], axis=1)
    rows = [int(np.flatnonzero(suns == sun)[0]) for sun in SUNS_DEG]
    return found[rows][:, [0, 2]] / found[rows][:, 1:2]


def cases(base: Medium) -> dict[str, Callable[[], Light]]:
    """Every candidate alone, then screens."""

    def screened(medium: Medium, *screen: Any) -> Callable[[], Light]:
        return lambda: Light(replace(medium, screen=Screen.of_clouds(*screen)))

    def cut(least_deg: float) -> Callable[[], Light]:
        return lambda: Light(base, response=lambda e, a: (e > least_deg).astype(float))

    out: dict[str, Callable[[], Light]] = {"continental-average at draft": lambda: Light(base)}
    out |= {f"horizon obstructed to {e} deg": cut(e) for e in (10, 20, 30)}
    out["sensor follows cosine^1.5"] = lambda: Light(base, response=lambda e, a: np.sqrt(np.sin(np.radians(e))))
    for height in (2.0, 8.0):
        out[f"what falls on a deck at {height:g} km"] = lambda z=height: Light(base, altitude_km=z)
    out["at standard"] = lambda: Light(base, "standard")
    out["no stratospheric aerosol"] = lambda: Light(air(aerosol__stratosphere="none"))
    for load in ("low", "elevated", "extreme"):
        out[f"stratosphere nh_midlat_{load}"] = lambda kind=load: Light(
            air(aerosol__stratosphere="none", stratosphere={"kind": f"nh_midlat_{kind}"})
        )
    out["clean tropospheric aerosol"] = lambda: Light(air(climate="continental-clean"))
    kind = {"kind": "nh_midlat_typical"}
    out["no tropospheric aerosol"] = lambda: Light(air(climate="pure-air", stratosphere=kind))
    out["pure air"] = lambda: Light(air(climate="pure-air"))
    for column in (250.0, 400.0):
        out[f"ozone {column:g} DU"] = lambda du=column: Light(air(gases__ozone__column_du=du))
    for top in (6.0, 8.0, 10.0, 12.0):
        out[f"clouds to {top:g} km from 300 km on stop all"] = screened(base, 1.0, top, 0.5, 300.0)
    for cover in (0.5, 0.8):
        out[f"clouds to 10 km from 300 km on stop {cover:.0%}"] = screened(base, cover, 10.0, 0.5, 300.0)
    for start in (0.0, 150.0):
        out[f"clouds to 8 km from {start:g} km on stop all"] = screened(base, 1.0, 8.0, 0.5, start)
    low = air(aerosol__stratosphere="none", stratosphere={"kind": "nh_midlat_low"})
    out["low stratosphere, clouds to 8 km from 300 km on stop all"] = screened(low, 1.0, 8.0, 0.5, 300.0)
    out["the same, horizon obstructed to 20 deg"] = lambda: Light(
        replace(low, screen=Screen.of_clouds(1.0, 8.0, 0.5, 300.0)), response=lambda e, a: (e > 20.0).astype(float)
    )
    return out


def candidates() -> None:
    targets = {s: measured(s) for s in SESSIONS}
    rows, first = [], None
    for name, make in cases(air()).items():
        found = make()
        first = first or found
        for k, sun in enumerate(SUNS_DEG):
            blue, green, red = found.ground[k]
            ratios = np.array([blue, red]) / green
            over = [f"{x:.2f}" for s in SESSIONS for x in ratios / targets[s][k]]
            fainter = -2.5 * np.log10(found.zenith[k, 1] / first.zenith[k, 1])
            rows.append([name, f"{sun:g}", *(f"{x:.3f}" for x in ratios), *over, f"{green / first.ground[k, 1]:.3f}",
                         f"{fainter:+.2f}", f"{found.components:.3f}"])  # fmt: skip
        print(name, flush=True)
    results.write(HERE / "red_twilight.csv", COLUMNS, rows)


def screens() -> None:
    """The screen of clouds that comes nearest to each session, by superposition of steps: light is linear in T."""
    base = air()
    rows = []
    for start in (0.0, 300.0):
        ramps = [Screen((h - WIDTH_KM, h + WIDTH_KM), (0.0, 1.0), start) for h in STEPS_KM]
        steps = [Light(base), *(Light(replace(base, screen=ramp)) for ramp in ramps)]
        ground, zenith = np.array([s.ground for s in steps]), np.array([s.zenith for s in steps])
        heights = np.array([-1.0, *STEPS_KM])
        for session in SESSIONS:
            target = measured(session)
            for most_mag in (0.1, np.inf):

                def light(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
                    passed = Screen.of_clouds(*parameters, start).at(heights)  # noqa: B023
                    part = np.diff(passed, prepend=0.0)
                    g, z = np.tensordot(part, ground, (0, 0)), np.tensordot(part, zenith, (0, 0))  # noqa: B023
                    fainter = -2.5 * np.log10(z[:, 1] / zenith[0, :, 1])  # noqa: B023
                    return passed, g[:, [0, 2]] / g[:, 1:2] / target, fainter  # noqa: B023

                def cost(parameters: np.ndarray) -> float:
                    _, ratio, fainter = light(parameters)
                    beyond = np.maximum(0.0, fainter[4:] - most_mag)  # noqa: B023
                    return float((np.log(ratio) ** 2).sum() + 100.0 * (beyond**2).sum())

                best = differential_evolution(cost, [(0.0, 1.0), (3.0, 22.0), (0.3, 5.0)], seed=1)
                _, ratio, fainter = light(best.x)
                allowed = "any" if np.isinf(most_mag) else f"{most_mag:g}"
                for k, sun in enumerate(SUNS_DEG):
                    rows.append([session, f"{start:g}", allowed, *(f"{x:.2f}" for x in best.x), f"{sun:g}",
                                 *(f"{x:.2f}" for x in ratio[k]), f"{fainter[k]:+.2f}"])  # fmt: skip
                print(session, start, allowed, best.x, flush=True)
    columns = ("session", "from_km", "zenith_mag_allowed_below_-4", "cover", "top_km", "top_spread_km", "sun_deg",
               "blue_over_measured", "red_over_measured", "zenith_mag")  # fmt: skip
    notes = ("the best clouds beyond the horizon for the colours of each session; steps of T, 1 km wide, added up",)
    results.write(HERE / "red_twilight_screens.csv", columns, rows, notes=notes)


LATE_SUNS_DEG = (0.0, -2.0, -4.0)
"""Suns at which `zones` and `montecarlo` are compared behind a screen."""


def scattered_once(medium: Medium, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Light scattered once (2, S, D, W) by `zones` and by `montecarlo`, in which neither has noise."""
    once = replace(zones.QUALITIES["draft"], max_orders=1)
    exact = montecarlo.MonteCarloSettings(target_stderr=None, samples=4, max_orders=1, importance_sweeps=0)
    fields = zones.prepare(medium, once, sun_elevations_deg=LATE_SUNS_DEG), montecarlo.prepare(medium, exact)
    return np.array([[field.radiance(sun, elevation, azimuth) for sun in LATE_SUNS_DEG] for field in fields])


def place() -> None:
    """`zones`, which counts distances from the lit point, beside `montecarlo`, which has clouds about the observer: the
    part of the light scattered once that is left."""
    elevation, azimuth = np.array([5.0, 20.0, 90.0, 20.0]), np.array([0.0, 0.0, 0.0, 180.0])
    base, rows = air().select(slice(1, 3)), []
    clear = scattered_once(base, elevation, azimuth)
    for start in (0.0, 150.0, 300.0):
        screened = replace(base, screen=Screen.of_clouds(0.8, 10.0, 1.0, start))
        left = scattered_once(screened, elevation, azimuth) / clear
        for s, d, w in np.ndindex(left.shape[1:]):
            where = (start, LATE_SUNS_DEG[s], elevation[d], azimuth[d], base.wavelength_nm[w])
            rows.append([*(f"{x:g}" for x in where), *(f"{part:.3f}" for part in left[:, s, d, w])])
        print(start, flush=True)
    columns = ("from_km", "sun_deg", "elevation_deg", "azimuth_deg", "wavelength_nm", "zones", "montecarlo")
    notes = ("clouds to 10 km that stop 80 %: part of the light scattered once that is left",)
    results.write(HERE / "red_twilight_place.csv", columns, rows, notes=notes)


def spectra() -> None:
    """What `twilight validate spectra` finds for each session from +5 to -8 deg, calibration fixed and free."""
    file = HERE / ".." / ".." / "shared" / "data" / "rural_twilight_spectra" / "sessions_2_3_4.csv"
    series = {str(s): recorded.at_nodes(recorded.read_spectra(file, str(s)), 5.0, -8.0) for s in SESSIONS}
    config, rows, fits = load_config(AIR, {"solver.quality": "draft"}), [], {}
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
    parts = {"candidates": candidates, "screens": screens, "place": place, "spectra": spectra}
    for part in sys.argv[1:] or parts:
        parts[part]()
