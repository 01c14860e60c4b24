"""`zones` below and above decks of cloud beside doubling and adding: python benchmarks/clouds.py

A deck of stratus alone, 1 km thick on a ground without curvature, light at 550 nm without polarisation.  The rows of
results/clouds_plane.csv are fluxes over F0 (direct light included), and radiances that are azimuthal means, which
delta scaling leaves as they are under thick decks alone; then the difference of each quality in per cent.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace

import numpy as np
import results

from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.base.errors import TwilightWarning
from twilight.numerics.directions import hemisphere
from twilight.solvers import zones

sys.path.insert(0, str(results.ROOT / "tests"))
from montecarlo_media import slab
from plane_parallel import Slabs

QUALITIES = ("draft", "standard")
DEPTHS = (0.1, 1.0, 10.0, 100.0)
SUNS_DEG = (60.0, 20.0)
STREAMS = 32
"""Cosines of each hemisphere of doubling and adding."""


def main() -> None:
    """Write the table."""
    warnings.simplefilter("ignore", TwilightWarning)
    phase = CloudLayer("stratus", 0.0, 1.0, 1.0, KINDS["stratus"].effective_radius_um).region(550.0).phase_functions[0]
    chi = phase.legendre_moments(2 * STREAMS)[0]
    f = chi[-1]
    azimuth = (np.arange(8) + 0.5) * 22.5
    rows = []
    for depth in DEPTHS:
        fields = [
            zones.prepare(
                slab(depth, 1.0, phase, radius_km=2e5),
                replace(zones.QUALITIES[quality], polarisation=False, refraction=False),
                sun_elevations_deg=SUNS_DEG,
            )
            for quality in QUALITIES
        ]
        for sun in SUNS_DEG:
            sine = float(np.sin(np.radians(sun)))
            truth = Slabs([(depth * (1.0 - f), 1.0, (chi[:-1] - f) / (1.0 - f))], 0.0, sine, STREAMS)
            inner = truth.cosine[:STREAMS]
            weight = 0.5 * np.polynomial.legendre.leggauss(STREAMS)[1]

            def means(field: zones.ZonesField, cosine: np.ndarray, side: float, sun: float = sun) -> np.ndarray:
                question = (sun, np.degrees(np.arcsin(side * cosine))[:, None], azimuth)
                return field.radiance(*question, observer_altitude_km=0.0 if side > 0.0 else 1.0)[..., 0].mean(axis=1)

            wanted = {"flux below": truth.flux_down[1], "flux above": truth.flux_up[0]}
            found: list[dict[str, float]] = []
            for field in fields:
                elevation, around, over = hemisphere(sun, 96, 64)
                found.append({
                    "flux below": sine * np.exp(-depth / sine) + over @ field.radiance(sun, elevation, around)[:, 0],
                    "flux above": 2.0 * np.pi * (weight * inner) @ means(field, inner, -1.0),
                })  # fmt: skip
            if depth >= 10.0:
                for cosine in (1.0, 0.7, 0.4, 0.2):
                    k = int(np.abs(truth.cosine - cosine).argmin())
                    name = f"at {np.degrees(np.arcsin(truth.cosine[k])):.0f} deg"
                    wanted[f"radiance below {name}"] = truth.down[1, k]
                    wanted[f"radiance above {name}"] = truth.up[0, k]
                    for field, into in zip(fields, found, strict=True):
                        into[f"radiance below {name}"] = means(field, truth.cosine[k : k + 1], 1.0)[0]
                        into[f"radiance above {name}"] = means(field, truth.cosine[k : k + 1], -1.0)[0]
            for what, value in wanted.items():
                off = [f"{100.0 * (one[what] / value - 1.0):.2f}" for one in found]
                rows.append([f"{depth:g}", f"{sun:g}", what, f"{value:.5g}", *off])
                print(*rows[-1], sep="\t", flush=True)
    columns = ["optical_depth", "sun_elevation_deg", "quantity", "reference", *(f"{q}_percent" for q in QUALITIES)]
    results.write(results.FOLDER / "clouds_plane.csv", columns, rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
