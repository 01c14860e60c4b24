"""Thirty radiances of the Prague sky model (Wilkie et al. 2021) beside `zones`: where both agree, and what parts them.

    python benchmarks/prague_sky.py [QUALITY]

The radiances are those that the tests of colour-science hold (colour/phenomena/sky/tests/test_wilkie2021.py, BSD
3-clause, Colour Developers): five directions, six channels of 40 nm.  The air of that model is known here by its
transmittance from the ground alone, also in those tests, so ours is `continental-average` in the US standard
atmosphere, its aerosol scaled until the transmittance at 540 nm is theirs.  It is computed as twilight has it,
and without refraction and stratospheric aerosol.
Writes benchmarks/prague_sky.csv: ratios of ours to theirs.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import results

import twilight
from twilight.numerics.spectrum import solar_irradiance

HERE = Path(__file__).parent
CENTRES_NM = (340.0, 380.0, 460.0, 540.0, 620.0, 700.0)
"""Of the six channels, 40 nm wide: those that hold 320, 380, 460, 540, 620 and 700 nm."""
WITHIN_NM = (-13.3, 0.0, 13.3)
"""Wavelengths of a channel, from its centre, at which it is computed."""
FITTED_CHANNEL = 3
DEPTHS = np.linspace(0.02, 0.4, 20)
"""Aerosol optical depths at 550 nm among which the one of their transmittance is found."""


@dataclass(frozen=True)
class PublishedSky:
    """A sky of theirs: radiance [W m-2 sr-1 nm-1] and transmittance from the ground to space in a direction [deg]."""

    name: str
    sun_deg: float
    elevation_deg: float
    azimuth_deg: float
    albedo: float
    altitude_km: float
    radiance: tuple[float, ...]
    transmittance: tuple[float, ...]


AT_45 = (2.6225886464e-01, 4.0168201340e-01, 5.9302223884e-01, 6.8508113960e-01, 7.4315036866e-01, 8.2037396166e-01)
PUBLISHED = (
    PublishedSky("45 deg, away from the sun", math.degrees(0.5236), 45.0, 180.0, 0.5, 0.0,
         (5.3107873172e-02, 5.6294252337e-02, 5.8964049089e-02, 3.2599713676e-02, 1.9265830095e-02, 1.2149839803e-02),
         AT_45),
    PublishedSky("zenith", math.degrees(0.5236), 90.0, 0.0, 0.5, 0.0,
         (4.8186861721e-02, 5.0425723522e-02, 5.4639955885e-02, 3.2298205668e-02, 2.0553615445e-02, 1.3661244550e-02),
         (3.8806037351e-01, 5.2700578388e-01, 6.9319275102e-01, 7.6748312617e-01, 8.1297748038e-01, 8.6946032117e-01)),
    PublishedSky("horizon below the sun", math.degrees(0.5236), 0.0, 0.0, 0.5, 0.0,
         (8.1679884518e-02, 1.4069905245e-01, 3.3032219097e-01, 3.3906134031e-01, 3.1930071062e-01, 2.9045508795e-01),
         AT_45),
    PublishedSky("twilight, 45 deg above the sun", math.degrees(-0.05), 45.0, 0.0, 0.5, 0.0,
         (3.7268466788e-04, 6.3494761833e-04, 1.0555130013e-03, 5.1896359629e-04, 3.5488616557e-04, 5.3453233851e-04),
         AT_45),
    PublishedSky("clearer air, 100 m, 45 deg, away", math.degrees(0.5236), 45.0, 180.0, 0.2, 0.1,
         (4.4284411690e-02, 4.5185516640e-02, 4.3990858779e-02, 2.2686369986e-02, 1.2535600923e-02, 7.4289074652e-03),
         (3.2105589852e-01, 4.8018432995e-01, 6.8234902643e-01, 7.6644676630e-01, 8.1459429167e-01, 8.8573679226e-01)),
)  # fmt: skip
TWILIGHT = PUBLISHED[3:4]
STRAIGHT = {"refraction.model": "none"}
"""Settings under which light goes straight."""
NO_STRATOSPHERE = {"aerosol.stratosphere": "none"}
"""Settings without the background of stratospheric aerosol."""
AIRS: dict[str, tuple[dict, tuple[PublishedSky, ...]]] = {
    "as it is": ({}, PUBLISHED),
    "without refraction": (STRAIGHT, TWILIGHT),
    "without stratospheric aerosol": (NO_STRATOSPHERE, TWILIGHT),
    "without either": (STRAIGHT | NO_STRATOSPHERE, PUBLISHED),
}
"""What is changed in our air, and the skies that are computed in it."""
COMMON = {"atmosphere.profile": "us_standard"}
WAVELENGTHS_NM = np.concatenate([np.array(WITHIN_NM) + centre for centre in CENTRES_NM])
SOLAR = np.array([solar_irradiance(np.arange(c - 19.5, c + 20.0)).mean() for c in CENTRES_NM])
"""Irradiance of the sun [W m-2 nm-1] in each channel."""


def in_channels(values: np.ndarray) -> np.ndarray:
    """Means (..., 6) over the channels of values (..., 18)."""
    return values.reshape(*values.shape[:-1], len(CENTRES_NM), len(WITHIN_NM)).mean(axis=-1)


def transmittance(settings: dict, case: PublishedSky) -> np.ndarray:
    """Of a slant line from the ground to space, at the wavelengths (18,); flat layers serve 45 deg and more."""
    depth = twilight.medium("continental-average", WAVELENGTHS_NM, settings).optical_depth()
    sine = 1.0 if case.name == "zenith" else math.sin(math.radians(45.0))
    return np.exp(-depth / sine)


def fitted_depth(settings: dict, case: PublishedSky) -> float:
    """The aerosol's optical depth at 550 nm under which the transmittance is theirs in FITTED_CHANNEL."""
    found = [
        in_channels(transmittance({**settings, "aerosol.optical_depth_550nm": float(d)}, case))[FITTED_CHANNEL]
        for d in DEPTHS
    ]
    return float(np.interp(-case.transmittance[FITTED_CHANNEL], -np.array(found), DEPTHS))


def main() -> None:
    quality = sys.argv[1] if len(sys.argv) > 1 else "draft"
    rows = []
    for air, (changed, cases) in AIRS.items():
        skies: dict[tuple[float, float], twilight.Solved] = {}
        for case in cases:
            settings = {**COMMON, **changed}
            of_air = PUBLISHED[0] if case.altitude_km == 0.0 else case
            depth = fitted_depth(settings, of_air)
            key = case.albedo, case.altitude_km
            if key not in skies:
                skies[key] = twilight.solve(
                    "continental-average", wavelength_nm=WAVELENGTHS_NM, altitude_km=case.altitude_km, quality=quality,
                    settings={**settings, "aerosol.optical_depth_550nm": depth, "ground.albedo": case.albedo},
                )  # fmt: skip
            solved = skies[key]
            light = np.asarray(
                solved.radiance(case.sun_deg, np.array([case.elevation_deg]), np.array([case.azimuth_deg]))
            )[0]
            ratio = in_channels(light) * SOLAR / np.array(case.radiance)
            passed = in_channels(transmittance({**settings, "aerosol.optical_depth_550nm": depth}, case))
            seen = passed / np.array(case.transmittance) if case.elevation_deg > 0.0 else np.full(6, np.nan)
            rows.append([air, case.name, f"{depth:.3f}", *(f"{r:.3f}" for r in ratio), *(f"{t:.3f}" for t in seen)])
            print(*rows[-1], sep=", ", flush=True)
    names = [f"{c:g}" for c in CENTRES_NM]
    head = ["air", "sky", "aerosol_optical_depth_550nm"]
    head += [f"radiance_ratio_{n}nm" for n in names] + [f"transmittance_ratio_{n}nm" for n in names]
    results.write(HERE / "prague_sky.csv", head, rows, notes=[f"zones {quality} over the Prague sky model"])


if __name__ == "__main__":
    main()
