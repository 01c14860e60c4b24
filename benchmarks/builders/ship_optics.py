"""The Mie results that come with the package, twilight/data/opac/mie_ten_types.npz.

python benchmarks/builders/ship_optics.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results

from twilight.atmosphere import mie, opac, shipped_optics
from twilight.atmosphere.mie import LogNormal
from twilight.atmosphere.stratosphere import SAGE_RADII_UM, droplets
from twilight.base.shipped_data import data_file


def particles() -> list[tuple[LogNormal, np.ndarray]]:
    """Sizes and refractive indices (W,) of those populations, and of measured stratospheres of typical loading."""
    wavelength_nm = shipped_optics.WAVELENGTHS_NM
    spheres = [opac.particles(component, humidity, wavelength_nm) for component, humidity in opac.populations()]
    sulphuric_acid = opac.particles("suso", 0.0, wavelength_nm)[1]
    return spheres + [(droplets(float(radius)), sulphuric_acid) for radius in SAGE_RADII_UM[1:5]]


def write(path: Path) -> None:
    """Compute all rows and write the file; some 10 s."""
    keys, rows = [], []
    for size, index in particles():
        for m, wavelength in zip(index, shipped_optics.WAVELENGTHS_NM, strict=True):
            keys.append(mie.cache_key(size, complex(m), wavelength))
            rows.append(mie.compute_optics(size, complex(m), wavelength))
    shipped_optics.write(path, keys, np.stack(rows))


if __name__ == "__main__":
    results.say_help(__doc__)
    write(Path(str(data_file(f"opac/{shipped_optics.FILE_NAME}"))))
