"""The standard observers, twilight/data/colour/observers.csv, from colour-science.

python benchmarks/ship_observers.py
"""

from __future__ import annotations

from pathlib import Path

import colour
import numpy as np

from twilight.numerics.spectrum import OBSERVERS, VISIBLE_NM

TABLE = Path(__file__).resolve().parents[1] / "twilight" / "data" / "colour" / "observers.csv"
HEAD = f"""# Standard observers of the CIE as colour-science {colour.__version__} has them: colour matching functions
# (CIE 1931 2 deg and CIE 1964 10 deg; CIE 018:2019), then the matrix from XYZ to linear Rec. 709.  For the 10 deg
# observer a Bradford adaptation takes its D65 white to that of Rec. 709, which is defined for 2 deg.
# python benchmarks/ship_observers.py
observer,wavelength_nm,x,y,z
"""


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
    TABLE.parent.mkdir(exist_ok=True)
    TABLE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"wrote {TABLE.name}: {len(lines)} rows")


if __name__ == "__main__":
    main()
