"""The airs of `clear_air_airs.py`, solved, in one file that outlives the machine that solved them.

    python benchmarks/builders/clear_air_kept.py FOLDER [FILE.npz]            writes clear_air_airs.npz

Light of every sample (air, observer, wavelength) as coefficients of principal components of ln M, of Q / M and of
U / M, in 16 bits: within 0.2 % at 95 % of all nodes; and the degree of each solution's phase
functions.
`clear_air_fit.py` reads such a file in place of a folder.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results

from twilight.base.whole_files import whole_file

KEPT = Path(__file__).with_name("clear_air_airs.npz")
COMPONENTS = {"light": 400, "polarised": 200}
DARKEST = 1e-32
"""Least M over F0 that is kept [sr^-1]."""


def degrees(airs: Path) -> dict[int, float]:
    """Degree of the phase functions in the solution of each file of airs, by its number; airs: a folder, or the file
    that `keep` writes."""
    if airs.is_dir():
        found = {}
        for path in airs.glob("*.npz"):
            with np.load(path) as file:
                found[int(path.stem)] = float(file["degree"])
        return found
    with np.load(airs) as file:
        return dict(zip(file["numbers"].tolist(), file["degree"].tolist(), strict=True))


def solved(airs: Path) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of each file its number, M over F0 (N, P) and Q / M, U / M (N, 2 P), N being observers x wavelengths; from a
    folder, or from the file that `keep` writes."""
    if airs.is_dir():
        for number in sorted(degrees(airs)):
            with np.load(airs / f"{number:05d}.npz") as file:
                light = np.moveaxis(file["light"], (-1, -2), (1, 2)).astype(float)  # observers W Stokes suns E A
            light = light.reshape(light.shape[0] * light.shape[1], 3, -1)
            multiple = np.maximum(light[:, 0], DARKEST)
            stokes = np.clip(light[:, 1:] / multiple[:, None], -1.0, 1.0)
            yield number, multiple, stokes.reshape(len(light), -1)
        return
    with np.load(airs) as file:
        arrays = {key: file[key] for key in file.files}
    for number in arrays["numbers"].tolist():
        some = arrays["number"] == number
        light, polarised = (
            (arrays[key][some] * arrays[f"{key}_scale"]) @ arrays[f"{key}_vectors"].astype(float)
            + arrays[f"{key}_mean"]
            for key in COMPONENTS
        )
        yield number, np.exp(light), polarised


def components(values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P,) and principal components (count, P) of values (N, P), from their largest covariances."""
    mean = values.mean(axis=0)
    rng = np.random.default_rng(0)
    start = rng.standard_normal((values.shape[1], count + 16)).astype(np.float32)
    centred = values - mean
    for _ in range(4):  # subspace iteration
        start, _ = np.linalg.qr(centred.T @ (centred @ start))
    _, _, turned = np.linalg.svd(centred @ start, full_matrices=False)
    return mean, (turned[:count] @ start.T).astype(np.float32)


def keep(folder: Path, path: Path) -> None:
    """Write the airs of a folder into one file, and say how near it is."""
    found, light, polarised = zip(*solved(folder), strict=True)
    degree = degrees(folder)
    arrays = {
        "numbers": np.array(found, np.int16),
        "degree": np.array([degree[number] for number in found], np.float32),
        "number": np.repeat(found, [len(one) for one in light]).astype(np.int16),
    }
    for key, rows in (("light", [np.log(one) for one in light]), ("polarised", polarised)):
        values = np.concatenate([row.astype(np.float32) for row in rows])
        mean, vectors = components(values, COMPONENTS[key])
        coefficients = (values - mean) @ vectors.T
        scale = np.abs(coefficients).max(axis=0) / np.iinfo(np.int16).max
        arrays |= {
            key: np.rint(coefficients / scale).astype(np.int16),
            f"{key}_scale": scale,
            f"{key}_mean": mean,
            f"{key}_vectors": vectors.astype(np.float16),
        }
        back = (arrays[key] * scale) @ vectors.astype(np.float16).astype(np.float32) + mean
        off = np.percentile(np.abs(back - values)[:, ::7], [95, 99.9])
        print(f"{key}: off by {off[0]:.5f} at 95 %, {off[1]:.5f} at 99.9 %")
    with whole_file(path) as unfinished, open(unfinished, "wb") as file:
        np.savez_compressed(file, **arrays)
    print(f"wrote {path.name}: {len(found)} files of airs, {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    results.say_help(__doc__)
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    keep(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else KEPT)
