"""How few wavelengths do: luminance and colour from some of them against those from 91, and where to place eight.

    python benchmarks/wavelengths.py           writes results/wavelengths.csv
    python benchmarks/wavelengths.py search    looks for the best places of eight from 380 nm on
    python benchmarks/wavelengths.py light     those of `light` and `timeline`, writes results/wavelengths_light.csv

Skies of `zones` at quality `draft` every 4 nm from 380 to 740 nm (`light`: `compact`, without bands, to 1000 nm), four
climates, nine suns from +30 to -15 deg, 35 directions.  Luminance: root mean square over the directions of a sky, mean
and largest of the skies.  CIEDE2000: over all directions, white at 1/0.18 of each sky's mean luminance.  What is beyond
the wavelengths is a power law.
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
from twilight.sky.quantities import responses
from twilight.sky.quantities.measure import MAX_UNCOVERED, Spectra, needed_nm, samples_for, uncovered
from twilight.solvers import compact, zones

CLIMATES = ("continental-average", "pure-air", "desert", "maritime-clean")
SUNS_DEG = (30.0, 5.0, 0.0, -3.0, -5.0, -7.0, -9.0, -12.0, -15.0)
FINE_NM = np.arange(380.0, 741.0, 4.0)
OBSERVER = "cie1964_10deg"


@cache
def skies() -> np.ndarray:
    """Sun-normalised radiance (skies, directions, wavelengths)."""
    found = []
    for climate in CLIMATES:
        field = zones.prepare(climate_medium(load_climate(climate), FINE_NM), zones.QUALITIES["draft"])
        found += [field.radiance(sun, *DIRECTIONS) for sun in SUNS_DEG]
        print(climate, file=sys.stderr, flush=True)
    return np.stack(found)


DIRECTIONS = tuple(
    v.ravel() for v in np.meshgrid([1.5, 4.0, 10.0, 20.0, 40.0, 65.0, 88.0], [0.0, 30.0, 90.0, 140.0, 180.0])
)


def light() -> None:
    """Errors of every response from the wavelengths of `samples_for`, beside those of fine spectra."""
    nm = np.concatenate([np.arange(320.0, 400.0, 2.0), np.arange(400.0, 1001.0, 4.0)])
    found = []
    for climate in CLIMATES:
        field = compact.prepare(climate_medium(load_climate(climate), nm), compact.CompactSettings(polarisation=False))
        found += [field.radiance(sun, *DIRECTIONS) for sun in SUNS_DEG]
    spectra, rows = np.concatenate(found), []
    for name in responses.names():
        one = responses.response(name)
        if needed_nm(one)[0] < nm[0] or uncovered(one, nm) > MAX_UNCOVERED:
            continue
        chosen = np.array([w for w in samples_for([one]) if w >= nm[0]])
        at = np.searchsorted(nm, chosen)
        few, fine = (Spectra(part, w, "astm_g173_etr") for part, w in ((spectra[:, at], nm[at]), (spectra, nm)))
        error = 100.0 * np.abs(few.weighted(one) / fine.weighted(one) - 1.0)
        rows.append([name, chosen.size, *(f"{v:.2f}" for v in (error.mean(), np.percentile(error, 95), error.max()))])
        print(*rows[-1], sep="\t")
    header = ["response", "wavelengths", "mean_percent", "p95_percent", "max_percent"]
    results.write(results.FOLDER / "wavelengths_light.csv", header, rows)


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
    for start in (PLACED_NM, np.linspace(380.0, 740.0, 8)):
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
    {"search": search, "light": light}.get("".join(sys.argv[1:]), main)()
