"""Tables, sentences and the picture of `twilight validate spectra`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.config.climate import Climate
from twilight.studies.validate.measured.spectra import HEIGHTS_KM, REFERENCE_NM, ZENITH_BELOW_DEG, Fit, Recorded

FIT_COLUMNS = (
    *("from_km", "rms_percent", "without_percent", "zenith_mag", "cover", "top_km", "top_spread_km"),
    *(f"T_{h:g}_km" for h in HEIGHTS_KM),
)
RESIDUAL_COLUMNS = ("wavelength_nm", "mean_percent", "rms_percent", "rms_without_percent", "calibration")
EACH_COLUMNS = ("sun_elevation_deg", "wavelength_nm", "recorded", "without_screen", "with_screen", "over_recorded")


def fit_rows(fits: Sequence[Fit]) -> list[list[str]]:
    """Rows of FIT_COLUMNS, with the standard error behind each T."""
    rows = []
    for fit in fits:
        cover, top, spread = fit.clouds
        bare = float(np.sqrt(np.mean(fit.log_bare**2)))
        passed = [f"{t:.2f}+-{e:.2f}" for t, e in zip(fit.transmission, fit.stderr, strict=True)]
        rows.append([f"{fit.from_km:g}", f"{100 * fit.rms:.1f}", f"{100 * bare:.1f}", f"{fit.zenith_mag.max():.2f}",
                     f"{cover:.2f}", f"{top:.1f}", f"{spread:.1f}", *passed])  # fmt: skip
    return rows


def write_fits(fits: Sequence[Fit], path: Path) -> None:
    """CSV of all fits, the nearest first."""
    write_csv(path, FIT_COLUMNS, fit_rows(fits))


def by_wavelength(recorded: Recorded, one: Fit) -> list[list[str]]:
    """Rows of RESIDUAL_COLUMNS: ln computed - ln recorded over all suns, each spectrum at its own level."""
    off, bare = 100.0 * one.log_ratio, 100.0 * one.log_bare
    return [
        [f"{nm:g}", f"{off[:, k].mean():+.1f}", f"{np.sqrt(np.mean(off[:, k] ** 2)):.1f}",
         f"{np.sqrt(np.mean(bare[:, k] ** 2)):.1f}", f"{one.calibration[k]:.3f}"]
        for k, nm in enumerate(recorded.wavelength_nm)
    ]  # fmt: skip


def _colours(recorded: Recorded, log_ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Recorded and computed light over that at 550 nm, (S, W) each."""
    green = _nearest(recorded, REFERENCE_NM)
    computed = recorded.irradiance * np.exp(log_ratio)
    return tuple(light / light[:, green : green + 1] for light in (recorded.irradiance, computed))  # type: ignore[return-value]


def write_residuals(recorded: Recorded, one: Fit, path: Path) -> None:
    """CSV of every sun and wavelength: light over that at 550 nm, recorded, computed without and with the screen."""
    measured, screened = _colours(recorded, one.log_ratio)
    bare = _colours(recorded, one.log_bare)[1]
    rows = [
        [f"{recorded.sun_deg[s]:g}", f"{recorded.wavelength_nm[w]:g}", f"{measured[s, w]:.4f}", f"{bare[s, w]:.4f}",
         f"{screened[s, w]:.4f}", f"{screened[s, w] / measured[s, w]:.3f}"]
        for s, w in np.ndindex(measured.shape)
    ]  # fmt: skip
    write_csv(path, EACH_COLUMNS, rows)


def write_evening(path: Path, climate: Climate, one: Fit) -> None:
    """The climate with the screen, a configuration for `twilight render`."""
    import yaml  # start-up

    screen = {
        "heights_km": list(HEIGHTS_KM),
        "transmission": [round(float(t), 4) for t in one.transmission],
        "from_km": one.from_km,
    }
    air = {"version": 1, **climate.model_dump(mode="json", exclude_none=True, exclude_defaults=True)}
    evening = {"version": 1, "climate": air, "horizon": {"screen": screen}}
    with whole_file(path) as temporary:
        temporary.write_text(yaml.safe_dump(evening, sort_keys=False, width=120), encoding="utf-8")


def sentences(one: Fit) -> list[str]:
    """What was found, and what these spectra do not determine."""
    cover, top, spread = one.clouds
    lines = ["nothing beyond the horizon brings the colours nearer"]
    if cover >= 0.02:
        clouds = f"clouds that stop {cover:.0%} of the beams, tops at {top:.1f} +- {spread:.1f} km"
        lines = [f"beyond the horizon, from {one.from_km:g} km on: {clouds}"]
    unsure = ", ".join(f"{h:g}" for h, e in zip(HEIGHTS_KM, one.stderr, strict=True) if e > 0.2)
    if unsure:
        lines.append(f"not determined by these spectra (standard error above 0.2): what passes at {unsure} km")
    return lines


def draw(recorded: Recorded, one: Fit, path: Path, title: str) -> None:
    """PNG: blue and red over green by the sun, recorded, without and with the screen; T by height."""
    from matplotlib.figure import Figure  # optional

    figure = Figure(figsize=(14, 4.6), layout="constrained")
    axes = figure.subplots(1, 3)
    measured, screened = _colours(recorded, one.log_ratio)
    bare = _colours(recorded, one.log_bare)[1]
    label = "with the screen" + ("" if np.all(one.calibration == 1.0) else " and the calibration")
    for axis, k in zip(axes[:2], (_nearest(recorded, 450.0), _nearest(recorded, 650.0)), strict=True):
        axis.fill_between(
            recorded.sun_deg, 0.9 * measured[:, k], 1.1 * measured[:, k], color="0.88", label="recorded +-10 %"
        )
        axis.plot(recorded.sun_deg, measured[:, k], "ks", ms=4)
        axis.plot(recorded.sun_deg, bare[:, k], "C0--", label="computed")
        axis.plot(recorded.sun_deg, screened[:, k], "C1", label=label)
        axis.set(xlabel="true elevation of the sun [deg]", ylabel=f"level ground, {recorded.wavelength_nm[k]:g}/550 nm")
        axis.legend(fontsize=8)
    axes[2].errorbar(one.transmission, HEIGHTS_KM, xerr=one.stderr, color="C1", marker="o", ms=3, capsize=2)
    axes[2].set(
        xlabel=f"part of the beams that passes, from {one.from_km:g} km on", ylabel="least altitude of the beam [km]",
        xlim=(-0.05, 1.3),
    )  # fmt: skip
    for axis in axes:
        axis.grid(alpha=0.3)
    fainter = one.zenith_mag[recorded.sun_deg <= ZENITH_BELOW_DEG].max(initial=0.0)
    below = f"zenith up to {fainter:.2f} mag fainter from {ZENITH_BELOW_DEG:g} deg on"
    figure.suptitle(f"{title}: colours within {100 * one.rms:.0f} % (rms); {below}")
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _nearest(recorded: Recorded, nm: float) -> int:
    return int(np.argmin(np.abs(recorded.wavelength_nm - nm)))
