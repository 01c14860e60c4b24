"""Mie results that come with the package: the ten OPAC types at the wavelengths used by default.

They save a fresh machine the compilation of the Mie kernels before its first picture.  They are a filled cache and
nothing else: an entry is found by the hash of everything that entered it, the file is checked against its own hash, and
a test computes a sample anew.  ``python -m twilight.atmosphere.shipped_optics`` writes the file.
"""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np

FILE_NAME = "mie_ten_types.npz"

WAVELENGTHS_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0, 450.0, 500.0, 550.0, 600.0, 650.0)
"""The default wavelengths of a render, then those of `twilight describe` that are not among them."""

HUMIDITY_PERCENT = 80.0


@dataclass(frozen=True)
class ShippedOptics:
    """Rows by their cache key, and the version of miepython that computed them."""

    miepython_version: str
    rows: dict[str, np.ndarray]


def _digest(version: str, keys: list[str], head: np.ndarray, log_phase: np.ndarray) -> str:
    h = hashlib.sha256(" ".join((version, *keys)).encode())
    h.update(np.ascontiguousarray(head, dtype="<f8").tobytes())
    h.update(np.ascontiguousarray(log_phase, dtype="<f4").tobytes())
    return h.hexdigest()


@lru_cache(maxsize=1)
def load() -> ShippedOptics:
    """The shipped rows; none where the file is absent or does not match its hash (then they are computed)."""
    path = resources.files("twilight") / "data" / "opac" / FILE_NAME
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            version, digest = str(file["miepython"]), str(file["digest"])
            keys, head, log_phase = [str(key) for key in file["key"]], file["head"], file["log_phase"]
    except (OSError, ValueError, KeyError):
        return ShippedOptics("", {})
    if _digest(version, keys, head, log_phase) != digest:
        return ShippedOptics("", {})
    rows = np.concatenate([head, log_phase.astype(float)], axis=1)
    return ShippedOptics(version, dict(zip(keys, rows, strict=True)))


def populations() -> list[tuple[str, float]]:
    """Component and humidity of every population in the ten types and their background."""
    from twilight.atmosphere import opac

    found = {(c, opac.FREE_TROPOSPHERE_HUMIDITY_PERCENT) for c in opac.FREE_TROPOSPHERE_PER_CM3}
    found |= {(c, 0.0) for c in (*opac.STRATOSPHERE_PER_CM3, "mitr")}
    for name in opac.opac_types():
        found |= {(c, HUMIDITY_PERCENT) for c in opac.opac_type(name).number_density_per_cm3}
    return sorted({(c, rh if opac.takes_up_water(c) else 0.0) for c, rh in found})


def write(path: Path) -> None:
    """Compute all rows and write the file; a minute or less."""
    from twilight.atmosphere import mie, opac

    version = mie.installed_miepython()
    keys, rows = [], []
    for component, humidity in populations():
        size, index = opac.particles(component, humidity, WAVELENGTHS_NM)
        for m, wavelength in zip(index, WAVELENGTHS_NM, strict=True):
            keys.append(mie.cache_key(size, complex(m), wavelength, version))
            rows.append(mie.compute_optics(size, complex(m), wavelength))
    table = np.stack(rows)
    head, log_phase = table[:, :3], table[:, 3:].astype(np.float32)
    np.savez_compressed(
        path,
        miepython=version,
        digest=_digest(version, keys, head, log_phase),
        key=np.array(keys),
        head=head,
        log_phase=log_phase,
    )


if __name__ == "__main__":
    write(Path(str(resources.files("twilight") / "data" / "opac" / FILE_NAME)))
