"""Mie results that come with the package: the ten OPAC types and measured stratospheres at the default wavelengths.

They save the first picture half a second.  They are a filled cache and nothing else: an entry is found by the hash of
everything that entered it, the file is checked against its own hash, and a test computes a sample anew.
``python benchmarks/builders/ship_optics.py`` writes the file.
"""

import hashlib
import io
from functools import lru_cache
from pathlib import Path

import numpy as np

from twilight.base.shipped_data import data_file
from twilight.base.whole_files import whole_file

FILE_NAME = "mie_ten_types.npz"
"""The file in data/opac."""

WAVELENGTHS_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 756.0, 450.0, 500.0, 550.0, 600.0, 650.0)
"""The default wavelengths of a render, then those of `twilight show NAME` that are not among them."""

RATIO_SCALE = 32767.0
"""Ratios of matrix elements are stored as multiples of one over this."""


def write(path: Path, keys: list[str], rows: np.ndarray) -> None:
    """Write rows (R, mie.ROW): ln P11 as float32, ratios of matrix elements as multiples of 1/RATIO_SCALE."""
    head, log_phase, ratios = np.split(rows, [3, 3 + (rows.shape[1] - 3) // 4], axis=1)
    log_phase = log_phase.astype("<f4")
    ratios = np.round(ratios * RATIO_SCALE).astype("<i2")
    with whole_file(path) as temporary:
        np.savez_compressed(
            temporary,
            digest=_digest(keys, head, log_phase, ratios),
            key=np.array(keys),
            head=head,
            log_phase=log_phase,
            ratios=ratios,
        )


def _digest(keys: list[str], *arrays: np.ndarray) -> str:
    h = hashlib.sha256(" ".join(keys).encode())
    for array in arrays:
        h.update(np.ascontiguousarray(array).tobytes())
    return h.hexdigest()


@lru_cache(maxsize=1)
def load() -> dict[str, np.ndarray]:
    """The shipped rows by their cache key; none where the file is absent or does not match its hash."""
    try:
        with np.load(io.BytesIO(data_file(f"opac/{FILE_NAME}").read_bytes()), allow_pickle=False) as file:
            digest = str(file["digest"])
            keys = [str(key) for key in file["key"]]
            head, log_phase, ratios = (file[key] for key in ("head", "log_phase", "ratios"))
    except (OSError, ValueError, KeyError):
        return {}
    if _digest(keys, head, log_phase, ratios) != digest:
        return {}
    rows = np.concatenate([head, log_phase.astype(float), ratios.astype(float) * (1.0 / RATIO_SCALE)], axis=1)
    return dict(zip(keys, rows, strict=True))
