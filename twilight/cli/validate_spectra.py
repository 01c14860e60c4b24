"""`twilight validate spectra`: what lay beyond the horizon, from spectra of level ground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar


def spectra(
    recorded: Annotated[Path, argument("SPECTRA", "CSV: sun_elevation_deg, then a column for each wavelength [nm].")],
    config: Annotated[str, option("CLIMATE_OR_CONFIG", "The air and the ground.")] = "continental-average",
    series: Annotated[
        str | None, option("NAME", "Of a file with several: the value of its column session or run.")
    ] = None,
    suns: Annotated[str, option("HIGH,LOW", "Elevations of the sun [deg] between which spectra count.")] = "0,-8",
    from_km: Annotated[
        str, option("KM,...", "Distances at which the screen may begin; the nearest fit is kept.")
    ] = "0,150,300",
    zenith: Annotated[
        float, option("MAG", "By how much the zenith may become fainter, sun at -4 deg and below; inf: by any.")
    ] = 0.1,
    as_recorded: Annotated[
        bool, flag("--as-recorded", "Do not divide by the ratio to computed light of the recording's own day.")
    ] = False,
    free_calibration: Annotated[
        bool, flag("--free-calibration", "A factor for each wavelength, the same for all suns, is free too.")
    ] = False,
    quality: Annotated[str, options.QUALITY] = "draft",
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path, option("DIR", "Folder for the tables, the picture and the evening.")] = Path("out/spectra"),
) -> None:
    """Fit what lay beyond the horizon to recorded spectra of level ground.

    Light is linear in what passes at each height, so that one solution for every height serves all fits. Each spectrum
    has a level of its own: colours are fitted. Writes fits.csv, residuals.csv, spectra.png and evening.yaml, the
    configuration with the screen that is nearest.
    """
    from twilight.base.whole_files import check_folder
    from twilight.config import load
    from twilight.studies.validate.measured import spectra as work
    from twilight.studies.validate.measured import spectra_report as report

    between = options.parse_numbers(suns, "--suns", -90.0, 90.0)
    if len(between) != 2 or between[0] < between[1]:
        raise TwilightError(f"--suns: {suns} must be two elevations, the higher one first, e.g. 0,-8")
    high, low = between
    starts = tuple(options.parse_numbers(from_km, "--from-km", 0.0, 2000.0))
    if not zenith >= 0.0:
        raise TwilightError(f"--zenith {zenith:g}: must be 0 or more")
    chosen = options.settings_of(settings)[0]
    loaded = load(config, {"solver.quality": quality} | chosen)
    day = high if as_recorded else max(high, work.DAY_DEG[1])
    measured = work.at_nodes(work.read_spectra(recorded, series), day, low)
    check_folder(output)
    output.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        bases = work.bases(loaded, measured, starts, bar)
    factor = None
    if not as_recorded:
        measured, bases, factor = work.on_own_day(measured, bases, high)
    fits = sorted((work.fit(measured, basis, zenith, free_calibration) for basis in bases), key=lambda one: one.rms)
    rows = report.fit_rows(fits)
    report.write_fits(fits, output / "fits.csv")
    report.write_residuals(measured, fits[0], output / "residuals.csv")
    report.write_evening(output / "evening.yaml", loaded.climate, fits[0])
    report.draw(measured, fits[0], output / "spectra.png", f"{recorded.name} {series or ''}".strip())
    print_table(list(report.FIT_COLUMNS), rows, right=tuple(range(len(report.FIT_COLUMNS))))
    print_table(list(report.RESIDUAL_COLUMNS), report.by_wavelength(measured, fits[0]), right=(0, 1, 2, 3, 4))
    if factor is not None:
        told = ", ".join(f"{f:.2f} at {nm:g} nm" for f, nm in zip(factor, measured.wavelength_nm, strict=True))
        print(f"recorded over computed by the recording's own day, which it was divided by: {told}")
    elif not as_recorded:
        print(f"no spectrum with the sun at {work.DAY_DEG[0]:g} deg or above: the light is as it was recorded")
    for line in report.sentences(fits[0]):
        print(line)
    print(f"wrote fits.csv, residuals.csv, spectra.png, evening.yaml to {output}/")
