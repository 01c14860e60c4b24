"""The screen beyond the horizon of usual evenings, `horizon: typical`, fitted jointly to what was measured of it:
python benchmarks/usual_screen.py writes usual_screen.csv.

Three numbers are sought: the height h up to which the transmission is t (it rises to 1 within RISE_KM above), t, and
the distance from which the screen counts.  Light is linear in the screen's steps (`spectra.py`), and is taken as linear
in the distance between those of FROM_KM.  The sum of squares is over

- level ground: ln computed over recorded of 650/550 and 450/550 nm, each session's median of the suns from 0 to -6 deg
  on the scale of its own day; the sessions' own scatter is the standard deviation, so that no screen explains it away;
- the zenith at Cosmic Campground, -4 to -12 deg, in the meter's band: its mean beside the zero's 0.1 mag, and the
  change along a straight line beside COURSE_MAG; no sun may be farther off than LIMIT_MAG;
- the zenith in deep twilight (BOSS): 650, 700, 800 and 850 over 500 nm, each beside BOSS_LN; what ozone and NO2 colour
  more than a screen does is left out.

Intervals: where the least sum of squares at a fixed value of one number is 1 (68 %) or 4 (95 %) above the least of all.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from itertools import pairwise
from typing import Any

import deep_twilight as boss
import numpy as np
import red_twilight as ground
import results

from twilight.base.digest import DISPLAY, code_digest
from twilight.config import load
from twilight.config.scene import TYPICAL
from twilight.studies.validate.measured import meter, photometry
from twilight.studies.validate.measured import spectra as recorded

FROM_KM = (0.0, 150.0, 300.0, 450.0, 600.0)
RISE_KM = 1.5
HEIGHTS_KM = np.arange(3.0, 16.01, 0.5)
TRANSMISSIONS = np.arange(0.0, 0.951, 0.05)
DISTANCES_KM = np.arange(0.0, 600.1, 50.0)
"""Where the sum of squares is taken."""
GROUND_NM = (450.0, 550.0, 650.0)
GROUND_SCATTER = 0.25
"""Standard deviation of ln of an evening's colour about that of usual evenings: that of the three sessions (1.60, 1.05
and 1.22 times red beside a clean horizon, 0.60, 0.95 and 0.83 times blue)."""
BOSS_NM = (650.0, 700.0, 800.0, 850.0)
BOSS_LN = 0.15
"""Standard deviation of ln of BOSS's colours: neighbouring bins of 10 nm differ by 0.1, and its formula, fitted to
computed skies, is off by up to as much (`deep_twilight.csv`)."""
ZERO_MAG = 0.1
"""Of the meter's zero [mag]."""
COURSE_MAG = 0.15
"""Of the change from -4 to -12 deg [mag]: the stratosphere's usual loads move -8 deg by 0.05 more than -6 deg
(`arm_prediction.csv`)."""
LIMIT_MAG = 0.1
"""By which a screen may be off at any sun [mag]."""
METER_DEG = np.arange(-4.0, -12.1, -1.0)
SUM = 7
"""Column of the sum of squares."""
TABLE = results.FOLDER / "usual_screen.csv"


def ground_bases(kept: results.Kept) -> tuple[dict[str, tuple[recorded.Recorded, np.ndarray]], np.ndarray]:
    """By session its light of dusk on the scale of its day, and its light under every part of a screen (D, J, S, W);
    and the zenith under every part of a screen at METER_DEG (D, J, M), over that without one."""
    series = {}
    for name in ground.SESSIONS:
        one = recorded.at_nodes(recorded.read_spectra(ground.FILE, name), 30.0, -6.0)
        k = [int(np.flatnonzero(one.wavelength_nm == nm)[0]) for nm in GROUND_NM]
        series[name] = recorded.Recorded(one.sun_deg, np.array(GROUND_NM), one.irradiance[:, k])
    suns = np.unique(np.concatenate([METER_DEG, *(one.sun_deg for one in series.values())]))[::-1]
    every = recorded.Recorded(suns, np.array(GROUND_NM), np.ones((suns.size, len(GROUND_NM))))
    rows = kept.rows("ground")
    if rows is None:
        bases = recorded.bases(load("continental-average", {"solver.quality": "draft"}), every, FROM_KM)
        rows = [[basis.from_km, basis.ground.tolist(), basis.zenith.tolist()] for basis in bases]
        kept.keep("ground", rows)
    bases = [recorded.Basis(start, np.array(light), np.array(zenith)) for start, light, zenith in rows]
    low = [int(np.flatnonzero(suns == sun)[0]) for sun in METER_DEG]
    zenith = np.stack([basis.zenith[:, low] / basis.zenith[0, low] for basis in bases])
    on_day: dict[str, Any] = {}
    for name, one in series.items():
        k = [int(np.flatnonzero(suns == sun)[0]) for sun in one.sun_deg]
        here = [replace(basis, ground=basis.ground[:, k], zenith=basis.zenith[:, k]) for basis in bases]
        on_day[name] = recorded.on_own_day(one, here, 0.0)
    factors = [factor for _, _, factor in on_day.values() if factor is not None]
    sensor = np.exp(np.mean(np.log(factors), axis=0))
    out = {}
    for name, (light, here, factor) in on_day.items():
        if factor is None:
            light = replace(light, irradiance=light.irradiance / sensor)
        out[name] = light, np.stack([basis.ground for basis in here])
    return out, zenith


def boss_basis() -> np.ndarray:
    """The difference of BOSS's zenith under every part of a screen, (D, J, W)."""

    def difference(horizon: Any) -> np.ndarray:
        field = boss.field_of(boss.air(), horizon)
        high, low = (field.radiance(sun, np.array([90.0]), np.array([0.0]))[0] for sun in boss.SUNS_DEG)
        return high - low

    bare = difference("clean")
    ramps = list(pairwise(recorded.HEIGHTS_KM))
    parts = [
        [difference({"screen": {"heights_km": pair, "transmission": [0.0, 1.0], "from_km": start}}) for pair in ramps]
        for start in FROM_KM
    ]
    return np.array([[bare, *of_start] for of_start in parts])


class Measured:
    """Everything that is measured, and the light under every part of a screen."""

    def __init__(self) -> None:
        kept = results.Kept("usual_screen", code_digest("twilight.engine.field", without=DISPLAY))
        self.sessions, self.zenith = ground_bases(kept)
        rows = kept.rows("boss")
        if rows is None:
            rows = boss_basis().tolist()
            kept.keep("boss", rows)
        self.boss = np.array(rows)
        clean = load("continental-average", {"solver.quality": "draft", "horizon": "clean"})
        light = photometry.Photometer(meter.site_of(clean), None, meter.METER_SITE.altitude_km)
        sky = meter.SkyQualityMeter(light, meter.METER_FLOOR_MAG)
        told = dict(zip(*(values.tolist() for values in meter.meter_zenith()), strict=True))
        self.clean_mag = np.array([sky.twilight_mag(float(sun)) - told[float(sun)] for sun in METER_DEG])

    def residuals(self, height_km: float, transmission: float, from_km: float) -> dict[str, np.ndarray]:
        """ln computed over measured by kind; of the meter in mag, computed minus measured."""
        nodes = np.array(recorded.HEIGHTS_KM)
        rises = np.diff(np.interp(nodes, [height_km, height_km + RISE_KM], [transmission, 1.0]), prepend=0.0)
        place = np.interp(from_km, FROM_KM, np.arange(len(FROM_KM)))
        weights = np.maximum(1.0 - np.abs(np.arange(len(FROM_KM)) - place), 0.0)

        def under(basis: np.ndarray) -> np.ndarray:
            return np.tensordot(rises, np.tensordot(weights, basis, 1), 1)

        out: dict[str, np.ndarray] = {}
        colours = []
        for light, basis in self.sessions.values():
            dusk = (light.sun_deg >= ground.DUSK_DEG[0]) & (light.sun_deg <= ground.DUSK_DEG[1])
            ratio = np.log(under(basis)[dusk] / light.irradiance[dusk])
            colours.append(np.median(ratio[:, [2, 0]] - ratio[:, [1]], axis=0))
        out["ground"] = np.array(colours)
        out["meter"] = self.clean_mag - 2.5 * np.log10(under(self.zenith))
        ratio = boss.over_measured(under(self.boss))
        out["boss"] = np.log(ratio[[list(boss.MEASURED).index(nm) for nm in BOSS_NM]])
        return out

    def squares(self, *screen: float) -> dict[str, float]:
        """The sum of squares by kind; and how far the meter is off at most [mag]."""
        r = self.residuals(*screen)
        change = float(np.polyfit(METER_DEG, r["meter"], 1)[0] * np.ptp(METER_DEG))
        return {
            "ground": float(np.sum(r["ground"] ** 2)) / GROUND_SCATTER**2,
            "meter": (float(r["meter"].mean()) / ZERO_MAG) ** 2 + (change / COURSE_MAG) ** 2,
            "boss": float(np.sum(r["boss"] ** 2)) / BOSS_LN**2,
            "farthest_mag": float(np.abs(r["meter"]).max()),
        }


def interval(axis: np.ndarray, least: np.ndarray, above: float) -> tuple[float, float]:
    """Where the least sums of squares along an axis are within `above` of the least of all."""
    inside = axis[least <= least.min() + above]
    return float(inside.min()), float(inside.max())


def main() -> None:
    """Fit, and write the table."""
    measured = Measured()
    axes = (HEIGHTS_KM, TRANSMISSIONS, DISTANCES_KM)
    kinds = ("ground", "meter", "boss")
    total = np.zeros((len(kinds), *(axis.size for axis in axes)))
    farthest = np.zeros(total.shape[1:])
    for index in itertools.product(*(range(axis.size) for axis in axes)):
        squares = measured.squares(*(float(axis[k]) for axis, k in zip(axes, index, strict=True)))
        total[(slice(None), *index)] = [squares[kind] for kind in kinds]
        farthest[index] = squares["farthest_mag"]
    rows: list[list[str]] = []

    def add(name: str, screen: tuple[float, float, float]) -> None:
        squares, r = measured.squares(*screen), measured.residuals(*screen)
        red, blue = np.exp(r["ground"]).T
        rows.append(
            [
                name, *(f"{x:g}" for x in np.round(screen, 3)),
                *(f"{squares[kind]:.2f}" for kind in kinds), f"{sum(squares[kind] for kind in kinds):.2f}",
                *(f"{x:.2f}" for x in (*red, *blue)), f"{r['meter'].min():+.2f}", f"{r['meter'].max():+.2f}",
                *(f"{x:.2f}" for x in np.exp(r["boss"])),
            ]
        )  # fmt: skip
        print(*rows[-1], flush=True)

    add("clean", (float(HEIGHTS_KM[0]), 1.0, 0.0))
    add("typical", (TYPICAL["heights_km"][0], TYPICAL["transmission"][0], TYPICAL["from_km"]))
    notes = []
    for name, chosen in (("joint", kinds), *((f"{kind} alone", (kind,)) for kind in kinds)):
        sums = total[[kinds.index(kind) for kind in chosen]].sum(axis=0)
        if len(chosen) > 1:
            sums = np.where(farthest <= LIMIT_MAG, sums, np.inf)
            above = float(rows[-1][SUM]) - float(sums.min())
            notes.append(f"typical: its sum of squares is {above:.1f} above the least; 3.5 holds 68 % of three numbers")
        best = np.unravel_index(np.argmin(sums), sums.shape)
        add(name, tuple(float(axis[k]) for axis, k in zip(axes, best, strict=True)))  # type: ignore[arg-type]
        for n, (axis, what) in enumerate(zip(axes, ("height [km]", "transmission", "distance [km]"), strict=True)):
            least = sums.min(axis=tuple(k for k in range(3) if k != n))
            one, two = interval(axis, least, 1.0), interval(axis, least, 4.0)
            notes.append(f"{name}: {what} {one[0]:g} to {one[1]:g} (68 %), {two[0]:g} to {two[1]:g} (95 %)")
            print(notes[-1], flush=True)
    columns = (
        "screen", "height_km", "transmission", "from_km", "squares_ground", "squares_meter", "squares_boss", "squares",
        *(f"session_{n}_{colour}_over_recorded" for colour in ("red", "blue") for n in ground.SESSIONS),
        "meter_least_mag", "meter_most_mag", *(f"boss_{nm:g}_nm" for nm in BOSS_NM),
    )  # fmt: skip
    results.write(TABLE, columns, rows, notes=notes)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
