"""Colour of the zenith in deep twilight beside BOSS sky spectra, and what each cause does at ozone's peak:
python benchmarks/deep_twilight.py writes deep_twilight.csv; and how haze sets the contrast of that sky beside an
all-sky camera: deep_contrast.csv.

Measured (Apache Point, 32.8 N, 2.79 km): light of the zenith with the sun at -14 deg minus that at -16 deg, medians of
10 nm, from the twilight term of a fit to calibrated BOSS sky spectra (P. Fagrelius, thesis; `dat/sky/MoonResults.csv`
of github changhoonhahn/feasiBGS, MIT licence).  The fit is

    I = (t0 |a| + t1 a^2 + t2 d^2 + t3 d) exp(-t4 X) + c0,

a the sun's elevation (-14 to -20 deg), d the angle from the sun, X the airmass, and leaves half of the variance: its
colour counts, not its level.  Computed by `zones`, draft, in the air of `continental-clean`, the observer at 2.79 km.
"""

from __future__ import annotations

import argparse
import functools
from typing import Any

import numpy as np
import results

import twilight
from twilight.atmosphere.gases import cross_section
from twilight.atmosphere.measured import climatological_column_du
from twilight.atmosphere.profiles import load_profile
from twilight.config import load
from twilight.config.scene import TYPICAL
from twilight.numerics.spectrum import solar_irradiance

MEASURED = {
    420.0: 2.1995, 450.0: 2.0484, 500.0: 1.1295, 530.0: 0.7321, 560.0: 0.4886, 580.0: 0.4189, 600.0: 0.3946,
    620.0: 0.3973, 650.0: 0.5300, 700.0: 0.7140, 800.0: 0.5839, 850.0: 0.4489,
}  # fmt: skip
"""I(-14 deg) - I(-16 deg) of the fit by wavelength [nm], in 1e-17 erg s^-1 cm^-2 A^-1 arcsec^-2."""
WAVELENGTHS_NM = np.array(list(MEASURED))
REFERENCE_NM = 500.0
"""Where computed over measured is 1 [nm]."""
HALF_WIDTH_NM = 5
"""The fit's wavelengths are medians over this distance on both sides [nm]."""
SUNS_DEG = (-14.0, -16.0)
FITTED_SUNS_DEG = (-14.0, -15.0, -16.0, -17.0, -18.0, -19.0, -20.0)
"""Suns of BOSS's twilight exposures, to which its formula is fitted."""
AIRMASSES = (1.0, 1.1, 1.2, 1.4)
AZIMUTHS_DEG = (0.0, 60.0, 120.0, 180.0)
"""Where the simulated exposures point; azimuth from the sun's."""
OBSERVER_KM = 2.79
LATITUDE_DEG = 32.8
SITE_DU = round(float(np.mean([climatological_column_du(LATITUDE_DEG, day) for day in range(1, 366)])))
"""Zonal mean of ozone at the site, mean over the year [DU]."""
TABLE = results.FOLDER / "deep_twilight.csv"
CONTRAST_NM = (450.0, 540.0, 600.0)
"""Blue, green and red of the camera [nm]."""
CONTRAST_MEASURED = (2.00, 2.07, 2.13)
"""Radiance towards over that away from the sun at airmass 2, sun at -14 deg: an all-sky camera in Chile at 2.7 km."""
CONTRAST_UP_DEG = 30.0
"""Elevation of airmass 2 [deg]."""
HAZES = (None, 0.0075, 0.015, 0.02, 0.03)
"""Optical depths of aerosol above the mountain at 550 nm; None: the climate's own."""
CONTRAST_TABLE = results.FOLDER / "deep_contrast.csv"


def air(column_du: float | None = SITE_DU, **sections: Any) -> dict[str, Any]:
    """`continental-clean` with a column of ozone; None: the profile's own."""
    climate = load("continental-clean").climate.model_dump(mode="json", exclude_unset=True)
    ozone = {"climatology": False} if column_du is None else {"column_du": column_du}
    gases = {"ozone": ozone} | sections.pop("gases", {})
    return climate | {"version": 1, "name": "deep-twilight", "gases": gases} | sections


def moved_ozone(up_km: float) -> dict[str, Any]:
    """The profile's levels, the ozone of each that of a level lower by up_km (the column is set apart)."""
    at = load_profile("midlatitude_summer")
    z, air_density = at.altitude_km, at.air_per_cm3
    ozone = np.exp(np.interp(z - up_km, z, np.log(at.o3_per_cm3)))
    parts = {"ozone_ppm": ozone, "water_vapour_ppm": at.h2o_per_cm3}
    levels = {"altitude_km": z, "pressure_hpa": at.pressure_hpa, "temperature_k": at.temperature_k}
    levels |= {name: 1e6 * density / air_density for name, density in parts.items()}
    return {"atmosphere": {"levels": {name: column.tolist() for name, column in levels.items()}}}


def screen(height_km: float = TYPICAL["heights_km"][0], **other: Any) -> dict[str, Any]:
    """The screen of `typical` with another height or other keys."""
    return {"screen": TYPICAL | {"heights_km": [height_km, height_km + 1.5]} | other}


TROPOSPHERE_KM = 12.0
"""Its top, above which NO2 is the stratosphere's [km]."""
THIN = {"type": "continental_clean", "optical_depth_550nm": 0.02}
"""Aerosol of which 0.01 is above the observer, as `mountain` has."""
CASES: dict[str, tuple[dict[str, Any], Any]] = {
    "clean, the profile's ozone": (air(None), "clean"),
    "typical, the profile's ozone": (air(None), "typical"),
    "typical, the site's ozone": (air(), "typical"),
    "clean, the site's ozone": (air(), "clean"),
    "ozone 280 DU": (air(280.0), "typical"),
    "ozone 220 DU": (air(220.0), "typical"),
    "ozone 3 km higher": (air(**moved_ozone(3.0)), "typical"),
    "ozone 3 km lower": (air(**moved_ozone(-3.0)), "typical"),
    "tropical profile": (air(atmosphere={"profile": "tropical"}), "typical"),
    "midlatitude winter profile": (air(atmosphere={"profile": "midlatitude_winter"}), "typical"),
    "screen up to 5 km": (air(), screen(5.0)),
    "screen up to 12 km": (air(), screen(12.0)),
    "screen up to 16 km": (air(), screen(16.0)),
    "screen from 100 km": (air(), screen(from_km=100.0)),
    "screen from 600 km": (air(), screen(from_km=600.0)),
    "no NO2": (air(gases={"no2": False}), "typical"),
    "stratosphere: nh_midlat_low": (air(stratosphere={"kind": "nh_midlat_low"}), "typical"),
    "stratosphere: nh_midlat_elevated": (air(stratosphere={"kind": "nh_midlat_elevated"}), "typical"),
    "optical depth of all aerosol 0.02 for 0.067": (air(aerosol=THIN), "typical"),
    "ozone 280 DU, 3 km higher, optical depth 0.02": (air(280.0, aerosol=THIN, **moved_ozone(3.0)), "typical"),
    "ground albedo 0.4": (air(ground={"albedo": 0.4}), "typical"),
}
"""The default, and one thing after another that may be otherwise: an air, and what lies beyond its horizon."""


@functools.cache
def solar() -> np.ndarray:
    """Solar irradiance, means over the fit's bins."""
    offsets = range(-HALF_WIDTH_NM, HALF_WIDTH_NM + 1)
    return np.mean([solar_irradiance(WAVELENGTHS_NM + offset) for offset in offsets], axis=0)


def field_of(climate: dict[str, Any], horizon: Any) -> twilight.Field:
    """The field of an air behind what lies beyond its horizon."""
    document = {"version": 1, "climate": climate, "observer": {"altitude_km": OBSERVER_KM}, "horizon": horizon}
    wavelengths = WAVELENGTHS_NM.tolist()
    return twilight.solve(document, solver="zones", wavelength_nm=wavelengths, settings={"solver.quality": "draft"})


def over_measured(difference: np.ndarray) -> np.ndarray:
    """A difference (W,) of sun-normalised radiances over the measured one, 1 at REFERENCE_NM."""
    ratio = difference * solar() / np.array(list(MEASURED.values()))
    return ratio / ratio[list(MEASURED).index(REFERENCE_NM)]


def by_the_fit(field: twilight.Field) -> np.ndarray:
    """The same difference as BOSS's formula has it when fitted to computed skies, (W,)."""
    rows, light = [], []
    for sun in FITTED_SUNS_DEG:
        for airmass in AIRMASSES:
            elevation = float(np.degrees(np.arcsin(1.0 / airmass)))
            sky = field.radiance(sun, np.full(len(AZIMUTHS_DEG), elevation), np.array(AZIMUTHS_DEG))
            for azimuth, radiance in zip(AZIMUTHS_DEG, sky, strict=True):
                rows.append((sun, angle_deg(sun, elevation, azimuth), airmass))
                light.append(radiance)
    a, d, x = np.array(rows).T
    radiance = np.array(light)
    radiance = radiance / radiance.max(axis=0)
    out = np.zeros(WAVELENGTHS_NM.size)
    for k in range(out.size):
        fits = []
        for t4 in np.linspace(-2.0, 2.0, 81):
            terms = np.stack([-a, a**2, d**2, d], axis=1) * np.exp(-t4 * x)[:, None]
            terms = np.concatenate([terms, np.ones((a.size, 1))], axis=1)
            found = np.linalg.lstsq(terms, radiance[:, k], rcond=None)[0]
            fits.append((float(np.sum((terms @ found - radiance[:, k]) ** 2)), t4, found))
        _, t4, t = min(fits, key=lambda one: one[0])
        zenith = [t[:4] @ (-sun, sun**2, (90.0 - sun) ** 2, 90.0 - sun) * np.exp(-t4) for sun in SUNS_DEG]
        out[k] = (zenith[0] - zenith[1]) * np.array(light)[:, k].max()
    return out


def contrasts() -> list[list[str]]:
    """Contrast of the mountain's sky by its haze, by wavelength."""
    rows = [["measured", "", *(f"{x:.2f}" for x in CONTRAST_MEASURED)]]
    for haze in HAZES:
        chosen = {} if haze is None else {"climate.aerosol.optical_depth_550nm": haze}
        document = {"version": 1, "climate": "mountain"}
        settings = {"solver.quality": "draft"} | chosen
        field = twilight.solve(document, solver="zones", wavelength_nm=list(CONTRAST_NM), settings=settings)
        depth = field.medium.notes["optical_depth"]
        own = sum(depth[part][1] for part in depth if part not in ("air", "ozone", "no2", "o4"))
        towards, away = field.radiance(SUNS_DEG[0], np.full(2, CONTRAST_UP_DEG), np.array([0.0, 180.0]))
        name = "mountain" if haze is None else f"mountain, haze {haze:g}"
        rows.append([name, f"{own:.4f}", *(f"{x:.2f}" for x in towards / away)])
        print(*rows[-1], flush=True)
    return rows


def angle_deg(sun_deg: float, elevation_deg: float, azimuth_deg: float) -> float:
    """Angle between the sun and a direction [deg]."""
    s, e, z = np.radians([sun_deg, elevation_deg, azimuth_deg])
    return float(np.degrees(np.arccos(np.sin(s) * np.sin(e) + np.cos(s) * np.cos(e) * np.cos(z))))


def main() -> None:
    """Compute the table."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.parse_args()
    rows = []

    def add(case: str, difference: np.ndarray) -> None:
        ratio = over_measured(difference)
        slope = ratio[list(MEASURED).index(600.0)] / ratio[list(MEASURED).index(530.0)]
        rows.append([case, *(f"{x:.3f}" for x in ratio), f"{slope:.3f}"])
        print(*rows[-1], flush=True)

    for case, (climate, horizon) in CASES.items():
        field = field_of(climate, horizon)
        high, low = (field.radiance(sun, np.array([90.0]), np.array([0.0]))[0] for sun in SUNS_DEG)
        add(case, high - low)
        if case == "typical, the site's ozone":
            add("the same, by BOSS's formula fitted to computed skies", by_the_fit(field))
    columns = ("case", *(f"{nm:g}_nm" for nm in WAVELENGTHS_NM), "600_over_530_nm")
    warm, cold = (cross_section("o3", [530.0, 600.0], [kelvin])[0] for kelvin in (293.0, 200.0))
    whole = load_profile("midlatitude_summer")
    above = whole.above(TROPOSPHERE_KM)
    notes = (
        f"computed over measured, 1 at {REFERENCE_NM:g} nm; the site's ozone is {SITE_DU} DU",
        "ozone's cross section at 600 less that at 530 nm, at 293 K over that at 200 K: "
        f"{(warm[1] - warm[0]) / (cold[1] - cold[0]):.3f}",
        f"NO2: {whole.column_per_cm2(whole.no2_per_cm3):.2g} cm^-2, above {TROPOSPHERE_KM:g} km "
        f"{above.column_per_cm2(above.no2_per_cm3):.2g}",
    )
    results.write(TABLE, columns, rows, notes=notes)
    columns = ("case", "haze_optical_depth_550nm", *(f"{nm:g}_nm" for nm in CONTRAST_NM))
    note = f"towards over away from the sun at {SUNS_DEG[0]:g} deg, {CONTRAST_UP_DEG:g} deg up"
    results.write(CONTRAST_TABLE, columns, contrasts(), notes=(note,))


if __name__ == "__main__":
    main()
