"""Compute the Mie results that come with the package: ``python -m twilight.atmosphere.ship_optics`` writes the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.atmosphere import mie, opac, shipped_optics
from twilight.atmosphere.mie import LogNormal
from twilight.atmosphere.stratosphere import SAGE_RADII_UM, droplets
from twilight.base.shipped_data import data_file

HUMIDITY_PERCENT = 80.0
"""Relative humidity at which the ten types ship [%]: the default of a climate."""


def populations() -> list[tuple[str, float]]:
    """Component and humidity of every population in the ten types and their background."""
    pairs = {(c, opac.FREE_TROPOSPHERE_HUMIDITY_PERCENT) for c in opac.FREE_TROPOSPHERE_PER_CM3}
    pairs |= {(c, 0.0) for c in (*opac.STRATOSPHERE_PER_CM3, "mitr")}
    for name in opac.opac_types():
        pairs |= {(c, HUMIDITY_PERCENT) for c in opac.opac_type(name).number_density_per_cm3}
    return sorted({(c, rh if opac.takes_up_water(c) else 0.0) for c, rh in pairs})


def particles() -> list[tuple[LogNormal, np.ndarray]]:
    """Sizes and refractive indices (W,) of those, and of the droplets of measured stratospheres of typical loading."""
    wavelength_nm = shipped_optics.WAVELENGTHS_NM
    spheres = [opac.particles(component, humidity, wavelength_nm) for component, humidity in populations()]
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
    write(Path(str(data_file(f"opac/{shipped_optics.FILE_NAME}"))))
