"""Standard observers and other spectra of colorimetry, twilight/data/colour/*.csv, from colour-science.

python benchmarks/builders/ship_colour.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import colour
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results
from colour.colorimetry import SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES as DAYLIGHT
from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019 as PRIMARIES

from twilight.numerics.spectrum import OBSERVERS, VISIBLE_NM
from twilight.sky.tone import SENSORS

FOLDER = Path(__file__).resolve().parents[2] / "twilight" / "data" / "colour"
HEAD = f"""# Standard observers of the CIE as colour-science {colour.__version__} has them: colour matching functions
# (CIE 1931 2 deg and CIE 1964 10 deg; CIE 018:2019), then the matrix from XYZ to linear Rec. 709.  For the 10 deg
# observer a Bradford adaptation takes its D65 white to that of Rec. 709, which is defined for 2 deg.
# python benchmarks/builders/ship_colour.py
observer,wavelength_nm,x,y,z
"""

SPECTRA_HEAD = f"""# Spectra of colorimetry as colour-science {colour.__version__} has them (BSD licence): V'(lambda) of
# the CIE 1951 scotopic observer; cameras' relative responses (Darrodi et al. 2015, JOSA A 32, 381; National Physical
# Laboratory); S0, S1 and S2 of CIE daylight (CIE 015:2018); the 24 patches of the ColorChecker (Ohta 1997); spectra
# whose sums have sRGB's colours (Mallett and Yuksel 2019, EGSR).
# python benchmarks/builders/ship_colour.py
spectrum,wavelength_nm,value
"""


def spectra() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Wavelengths [nm] and values of each spectrum, by its name."""
    scotopic = colour.SDS_LEFS["CIE 1951 Scotopic Standard Observer"]
    found = {"scotopic": (scotopic.wavelengths, scotopic.values)}
    rgb = [(name, colour.MSDS_CAMERA_SENSITIVITIES[known_as]) for name, known_as in SENSORS.items()]
    for name, curves in [*rgb, ("mallett", PRIMARIES)]:
        for channel, column in zip(("red", "green", "blue"), curves.values.T, strict=True):
            found[f"{name} {channel}"] = (curves.wavelengths, column)
    patches = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    several = [(f"daylight {name}", one) for name, one in DAYLIGHT.items()]
    several += [(f"patch {k + 1}", one) for k, one in enumerate(patches.values())]
    return found | {name: (one.wavelengths, one.values) for name, one in several}


def table_of(name: str) -> np.ndarray:
    """Matching functions (471, 3) of an observer and, below them, its matrix from XYZ to linear Rec. 709."""
    functions = colour.MSDS_CMFS[OBSERVERS[name]]
    if not np.array_equal(functions.wavelengths, VISIBLE_NM):
        raise SystemExit(f"colour-science {colour.__version__} tabulates '{name}' on another grid")
    space = colour.RGB_COLOURSPACES["ITU-R BT.709"].copy()
    space.use_derived_transformation_matrices(True)
    white = colour.CCS_ILLUMINANTS[OBSERVERS[name]]["D65"]
    rows = colour.XYZ_to_RGB(np.eye(3), space, illuminant=white, chromatic_adaptation_transform="Bradford")
    return np.concatenate([functions.values, np.transpose(rows)])


def main() -> None:
    lines = []
    for name in OBSERVERS:
        labels = [*(f"{nm:g}" for nm in VISIBLE_NM), "red", "green", "blue"]
        for label, row in zip(labels, table_of(name), strict=True):
            lines.append(",".join([name, label, *(repr(float(value)) for value in row)]))
    (FOLDER / "observers.csv").write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    lines = [f"{name},{x:g},{float(y)!r}" for name, (nm, v) in spectra().items() for x, y in zip(nm, v, strict=True)]
    (FOLDER / "spectra.csv").write_text(SPECTRA_HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
