"""Tables, sentences and pictures of `twilight validate photometry` and `twilight validate spectra`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.whole_files import save_figure, whole_file, write_csv
from twilight.config.climate import Climate
from twilight.studies.validate.measured import meter, photometry
from twilight.studies.validate.measured.spectra import HEIGHTS_KM, REFERENCE_NM, ZENITH_BELOW_DEG, Fit, Recorded

POINT_COLUMNS = (
    *("climate", "quantity", "site", "observer_altitude_km", "sun_elevation_deg"),
    *("computed", "of_which_night", "measured", "log10_ratio"),
)
MOONLIT_COLUMNS = (
    *("climate", "phase_angle_deg", "moon_elevation_deg", "readings"),
    *("computed_mag_per_arcsec2", "measured_p75_mag_per_arcsec2", "difference_mag"),
)
LEVEL_COLUMNS = (
    *("climate", "quantity", "site", "sun_from_deg", "sun_to_deg", "points"),
    *("factor", "level_dex", "lowest_dex", "highest_dex", "slope_difference_dex_per_deg"),
)


def write_points(points: Sequence[photometry.PhotometricPoint], path: Path) -> None:
    """CSV of all points; illuminance in lx, luminance in cd m^-2; empty where nothing was measured."""
    rows = []
    for p in points:
        known = np.isfinite(p.measured)
        rows.append(
            [p.climate, p.quantity, p.site, f"{p.observer_altitude_km:g}", f"{p.sun_elevation_deg:g}"]
            + [f"{p.computed:.5g}", f"{p.night:.4g}"]
            + ([f"{p.measured:.5g}", f"{p.log_ratio:+.3f}"] if known else ["", ""])
        )
    write_csv(path, POINT_COLUMNS, rows)


def level_rows(levels: Sequence[photometry.Level]) -> list[list[str]]:
    """Rows of LEVEL_COLUMNS."""
    return [
        [v.climate, v.quantity, v.site, f"{v.low_deg:g}", f"{v.high_deg:g}", str(v.count), f"{v.factor:.2f}"]
        + [f"{x:+.3f}" for x in (v.level_dex, v.lowest_dex, v.highest_dex)]
        + [f"{v.slope_difference:+.4f}"]
        for v in levels
    ]


def write_levels(levels: Sequence[photometry.Level], path: Path) -> None:
    """CSV of levels and slopes."""
    write_csv(path, LEVEL_COLUMNS, level_rows(levels))


def write_moonlit(points: Sequence[meter.MoonlitPoint], path: Path) -> None:
    """CSV of the zenith under the moon."""
    rows = []
    for p in points:
        place = (f"{x:g}" for x in (p.phase_angle_deg, p.moon_elevation_deg, p.readings))
        off = f"{p.computed_mag - p.measured_mag:+.2f}"
        rows.append([p.climate, *place, f"{p.computed_mag:.2f}", f"{p.measured_mag:.2f}", off])
    write_csv(path, MOONLIT_COLUMNS, rows)


def draw(points: Sequence[photometry.PhotometricPoint], moonlit: Sequence[meter.MoonlitPoint], path: Path) -> None:
    """PNG: illuminance and zenith luminance over sun elevation, log10 ratio to the measurements below them; the zenith
    in the meter's band, under the moon, and the colour of level ground."""
    from matplotlib.figure import Figure  # optional

    figure = Figure(figsize=(15, 15), layout="constrained")
    axes = figure.subplots(4, 3, gridspec_kw={"height_ratios": [2.2, 1, 2.2, 1]})
    panels = [("illuminance", "ground", "illuminance of level ground [lx]")]
    for site in meter.KOOMEN_SITES:
        label = f"zenith luminance, {site.name}, {1000 * site.altitude_km:.0f} m [cd m$^{{-2}}$]"
        panels.append(("zenith luminance", site.name, label))
    climates = list(dict.fromkeys(p.climate for p in points))
    for column, (quantity, name, label) in enumerate(panels):
        top, bottom = axes[0, column], axes[1, column]
        for i, climate in enumerate(climates):
            line = [p for p in points if (p.climate, p.quantity, p.site) == (climate, quantity, name)]
            sun = [p.sun_elevation_deg for p in line]
            top.plot(sun, [p.computed for p in line], color=f"C{i}", label=climate, lw=1.4)
            if any(p.night > 0 for p in line):
                without = [p.computed - p.night for p in line]
                top.plot(sun, without, color=f"C{i}", ls=":", lw=1.2, label="without the night sky" if i == 0 else None)
            known = [p for p in line if np.isfinite(p.measured)]
            marker = None if quantity == "illuminance" else "o"
            bottom.plot(
                [p.sun_elevation_deg for p in known], [p.log_ratio for p in known], color=f"C{i}", marker=marker, lw=1.2
            )
        if quantity == "illuminance":
            fine = np.linspace(-18, 60, 400)
            top.plot(fine, meter.horizontal_illuminance_lux(fine), "k--", lw=1.2, label="Janiczek and DeYoung 1987")
        else:
            top.plot(*meter.zenith_luminance_cd_m2(name), "ks", label="Koomen et al. 1952")
        top.set(yscale="log", ylabel=label)
        bottom.set(xlabel="true elevation of the sun [deg]", ylabel="log$_{10}$ computed / measured")
        _ruled(top, bottom, 0.3, 0.6)
        top.legend(fontsize=8)
    _draw_meter(points, climates, axes[2, 0], axes[3, 0])
    _draw_moonlit(moonlit, climates, axes[2, 1], axes[3, 1])
    for axis, quantity in zip(axes[2:, 2], photometry.COLOURS, strict=True):
        _draw_colour(points, climates, quantity, axis)
    axes[1, 0].text(0.02, 0.03, "grey: a factor 2", transform=axes[1, 0].transAxes, fontsize=8)
    save_figure(path, figure, 110)


def _ruled(top: Any, bottom: Any, good: float, most: float) -> None:
    """Grids; in the lower panel, of differences up to `most`, a line at 0 and grey where they are `good` at most."""
    bottom.axhspan(-good, good, color="0.92", zorder=0)
    bottom.axhline(0, color="0.5", lw=0.8)
    bottom.set(ylim=(-most, most))
    for axis in (top, bottom):
        axis.grid(alpha=0.3)


def _draw_meter(points: Sequence[photometry.PhotometricPoint], climates: list[str], top: Any, bottom: Any) -> None:
    """Magnitudes of the zenith in the meter's band, and computed less measured."""
    for i, climate in enumerate(climates):
        line = [p for p in points if p.quantity == photometry.METER_QUANTITY and p.climate == climate]
        sun = [p.sun_elevation_deg for p in line]
        top.plot(sun, [photometry.meter_magnitude(p.computed) for p in line], color=f"C{i}", label=climate, lw=1.4)
        off = [photometry.meter_magnitude(p.computed) - photometry.meter_magnitude(p.measured) for p in line]
        bottom.plot(sun, off, color=f"C{i}", marker="o", ms=3, lw=1.2)
    suns, clear = meter.meter_zenith()
    top.plot(suns, clear, "ks", ms=4, label="563 clear twilights")
    top.fill_between(
        suns, meter.meter_zenith("all_p25")[1], meter.meter_zenith("all_p75")[1], color="0.85", label="all, quartiles"
    )
    where = f"zenith, {meter.METER_SITE.name}, {1000 * meter.METER_SITE.altitude_km:.0f} m"
    top.set(ylabel=f"{where}\n[mag arcsec$^{{-2}}$ in the meter's band]")
    top.invert_yaxis()
    top.legend(fontsize=8)
    bottom.set(xlabel="true elevation of the sun [deg]", ylabel="computed - measured [mag]")
    _ruled(top, bottom, 0.1, 0.5)
    note = "grey: 0.1 mag, as well as the meter's zero is known"
    bottom.text(0.02, 0.05, note, transform=bottom.transAxes, fontsize=8)


def _draw_moonlit(moonlit: Sequence[meter.MoonlitPoint], climates: list[str], top: Any, bottom: Any) -> None:
    """The zenith by the moon's elevation, a line for every phase angle, and computed less measured."""
    first = [p for p in moonlit if p.climate == climates[0]]
    phases = sorted({p.phase_angle_deg for p in first})
    for i, phase in enumerate(phases):
        colour = str(0.75 * i / max(1, len(phases) - 1))
        line = [p for p in first if p.phase_angle_deg == phase]
        up = [p.moon_elevation_deg for p in line]
        top.plot(up, [p.computed_mag for p in line], color=colour, lw=1.2, label=f"{phase:g} deg")
        top.plot(up, [p.measured_mag for p in line], "s", color=colour, ms=4)
    for i, climate in enumerate(climates):
        line = [p for p in moonlit if p.climate == climate]
        off = [p.computed_mag - p.measured_mag for p in line]
        bottom.plot([p.moon_elevation_deg + 0.6 * i for p in line], off, "o", color=f"C{i}", ms=3)
    top.set(ylabel=f"the same under the moon: {climates[0]} (lines),\n75th percentile of readings (squares)")
    top.invert_yaxis()
    top.legend(fontsize=7, title="phase angle", title_fontsize=7, ncols=2)
    bottom.set(xlabel="elevation of the moon [deg]", ylabel="computed - measured [mag]")
    _ruled(top, bottom, 0.2, 0.8)


def _draw_colour(points: Sequence[photometry.PhotometricPoint], climates: list[str], quantity: str, axis: Any) -> None:
    """A ratio of irradiances of level ground: computed, and measured in each session."""
    of_quantity = [p for p in points if p.quantity == quantity]
    for i, climate in enumerate(climates):
        line = {p.sun_elevation_deg: p.computed for p in of_quantity if p.climate == climate}
        axis.plot(sorted(line), [line[sun] for sun in sorted(line)], color=f"C{i}", lw=1.4)
    for session, marker in zip(meter.SESSIONS, "v^s", strict=True):
        line = {p.sun_elevation_deg: p.measured for p in of_quantity if p.site == f"session {session}"}
        axis.plot(list(line), list(line.values()), "k" + marker, ms=4, label=f"session {session}")
    nm = "450" if quantity == photometry.COLOURS[0] else "650"
    axis.set(xlabel="true elevation of the sun [deg]", ylabel=f"level ground, {nm}/550 nm")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, title="Spitschan et al. 2016", title_fontsize=8)


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


def draw_spectra(recorded: Recorded, one: Fit, path: Path, title: str) -> None:
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
    save_figure(path, figure, 110)


def _nearest(recorded: Recorded, nm: float) -> int:
    return int(np.argmin(np.abs(recorded.wavelength_nm - nm)))
