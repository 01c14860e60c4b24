"""How few wavelengths do: luminance and colour from some of them against those from 91, and where to place eight.

    python benchmarks/wavelengths.py           writes results/wavelengths.csv
    python benchmarks/wavelengths.py search    looks for the best places of eight between 380 and 720 nm

Skies of `zones` at quality `draft` every 4 nm from 380 to 740 nm: four climates, nine suns from +30 to -15 deg, 35
directions.  Luminance: root mean square over the directions of a sky, mean and largest of the skies.  CIEDE2000: over
all directions, white at 1/0.18 of each sky's mean luminance.  What is beyond the wavelengths is a power law.
"""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.config.scene import PLACED_NM
from twilight.scene.medium import climate_medium
from twilight.sky.colour import MIDDLE_GREY, spectrum_to_xyz
from twilight.solvers import zones

CLIMATES = ("continental-average", "pure-air", "desert", "maritime-clean")
SUNS_DEG = (30.0, 5.0, 0.0, -3.0, -5.0, -7.0, -9.0, -12.0, -15.0)
FINE_NM = np.arange(380.0, 741.0, 4.0)
OBSERVER = "cie1964_10deg"


@cache
def skies() -> np.ndarray:
    """Sun-normalised radiance (skies, directions, wavelengths)."""
    elevation, azimuth = np.meshgrid([1.5, 4.0, 10.0, 20.0, 40.0, 65.0, 88.0], [0.0, 30.0, 90.0, 140.0, 180.0])
    found = []
    for climate in CLIMATES:
        field = zones.prepare(climate_medium(load_climate(climate), FINE_NM), zones.QUALITIES["draft"])
        found += [field.radiance(sun, elevation.ravel(), azimuth.ravel()) for sun in SUNS_DEG]
        print(climate, file=sys.stderr, flush=True)
    return np.stack(found)


@cache
def true_colour() -> np.ndarray:
    return spectrum_to_xyz(skies(), FINE_NM, observer=OBSERVER)


def relative_errors(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """XYZ from some of the wavelengths, and its relative error, (skies, directions, 3)."""
    xyz = spectrum_to_xyz(skies()[..., chosen], FINE_NM[chosen], observer=OBSERVER)
    return xyz, xyz / true_colour() - 1.0


def cost(chosen: np.ndarray) -> float:
    """Typical and largest errors of luminance, and half as much of the other two coordinates relative to it."""
    error = relative_errors(np.sort(chosen))[1]
    light = np.sqrt((error[..., 1] ** 2).mean(axis=1))
    tint = np.sqrt(((error[..., [0, 2]] - error[..., 1:2]) ** 2).sum(axis=-1).mean(axis=1))
    rms = [float(np.sqrt((e**2).mean())) for e in (light, tint)]
    return rms[0] + 0.5 * light.max() + 0.5 * rms[1] + 0.25 * tint.max()


def figures(chosen: np.ndarray) -> list[float]:
    """Luminance, mean and largest [%]; CIEDE2000, median, 95th percentile, largest."""
    import colour

    xyz, error = relative_errors(chosen)
    light = 100.0 * np.sqrt((error[..., 1] ** 2).mean(axis=1))
    white = np.exp(np.log(true_colour()[..., 1]).mean(axis=1))[:, None, None] / MIDDLE_GREY
    d65 = colour.CCS_ILLUMINANTS["CIE 1964 10 Degree Standard Observer"]["D65"]
    ours, right = (colour.XYZ_to_Lab(v / white, d65) for v in (xyz, true_colour()))
    difference = colour.delta_E(ours, right, method="CIE 2000")
    return [light.mean(), light.max(), np.median(difference), np.percentile(difference, 95), difference.max()]


def nearest(wavelength_nm) -> np.ndarray:
    return np.array([int(np.abs(FINE_NM - w).argmin()) for w in wavelength_nm])


def search() -> None:
    """Descend from the places in use and from equidistant ones, one wavelength at a time, the ends held."""
    for start in (PLACED_NM, np.linspace(380.0, 720.0, 8)):
        best = nearest(start)
        least, moved = cost(best), True
        while moved:
            moved = False
            for k in range(1, best.size - 1):
                for j in range(best[k] - 4, best[k] + 5):
                    trial = best.copy()
                    trial[k] = j
                    if best[k - 1] < j < best[k + 1] and (found := cost(trial)) < least - 1e-6:
                        best, least, moved = trial, found, True
        print([f"{w:g}" for w in FINE_NM[best]], f"{least:.4f}", *(f"{x:.2f}" for x in figures(best)))


def main() -> None:
    sets = {f"{n} equidistant": np.linspace(380.0, 720.0, n) for n in (4, 6, 8, 12, 16, 22)}
    sets["8 placed, the default"] = np.array(PLACED_NM)
    header = ["wavelengths", "luminance_mean_percent", "luminance_max_percent"]
    header += ["ciede2000_median", "ciede2000_p95", "ciede2000_max", "nm"]
    rows = []
    for name, wavelength_nm in sets.items():
        chosen = nearest(wavelength_nm)
        rows.append([name, *(f"{x:.2f}" for x in figures(chosen)), " ".join(f"{w:g}" for w in FINE_NM[chosen])])
        print(*rows[-1], sep="\t")
    results.write(results.FOLDER / "wavelengths.csv", header, rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    search() if sys.argv[1:] == ["search"] else main()
