"""Spectral responses and Vega, twilight/data/photometry/*.csv, from other packages' files.

python benchmarks/builders/ship_responses.py --vega alpha_lyr_stis_011.fits --alpha-opic S026_Table2_Data.csv \\
    --sqm sqm.dat

The first is in the package pyphot (pyphot/libs), the second in luxpy (luxpy/toolboxes/photbiochem/data), the third in
the repository github.com/aubema/illumina (illum/data/Example/Lights); speclite must be installed.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
import speclite
from astropy.io import fits
from speclite import filters

FOLDER = Path(__file__).resolve().parents[2] / "twilight" / "data" / "photometry"
BANDS = {
    **{name: f"bessell-{name}" for name in "UBVRI"},
    **{name: f"lsst2023-{name}" for name in "ugrizy"},
    **{f"sdss-{name}": f"sdss2010-{name}" for name in "ugriz"},
    **{f"gaia-{name}": f"gaiadr3-{name}" for name in ("G", "BP", "RP")},
}
LAST_NM = 1150.0
SMALLEST = 1e-3
"""Ends of a curve below this fraction of its maximum are cut off."""

BANDS_HEAD = f"""
Responses of photometric bands, as speclite {speclite.__version__} has them (BSD licence), to {LAST_NM:g} nm.  UBVRI:
Johnson-Cousins, response to energy (Bessell 1990, PASP 102, 1181; Bessell, Castelli & Plez 1998, appendix E).  Per
photon: ugrizy, LSST with the air of its site, air mass 1.2 (github.com/lsst/throughputs 1.9); sdss-ugriz through air
mass 1.3 (Doi et al. 2010, AJ 139, 1628); gaia-G, BP, RP of DR3 (Riello et al. 2021, A&A 649, A3).
python benchmarks/builders/ship_responses.py"""
VEGA_HEAD = """
Vega, W m-2 nm-1, means over 1 nm: CALSPEC alpha_lyr_stis_011 (STScI, public domain; Bohlin, Gordon & Tremblay 2014,
PASP 126, 711), as distributed with pyphot.
python benchmarks/builders/ship_responses.py"""
ALPHA_OPIC_HEAD = """
Action spectra of the five photoreceptors of the eye, CIE S 026:2018 table 2 (cones after CIE 170-1:2006, 10 deg; rods
V'(lambda); melanopsin behind its lens), as distributed with luxpy, which had them from cie.co.at; blank cells are 0.
python benchmarks/builders/ship_responses.py"""
SQM_HEAD = """
Relative response of the Sky Quality Meter (TSL237 behind a HOYA CM-500), as distributed with the model Illumina
(github.com/aubema/illumina, illum/data/Example/Lights/sqm.dat).
python benchmarks/builders/ship_responses.py"""


def band_rows() -> list[list[str]]:
    rows = []
    for name, known_as in BANDS.items():
        curve = filters.load_filter(known_as)
        nm, response = np.asarray(curve.wavelength) / 10.0, np.asarray(curve.response, float)
        step = 1.0 if np.diff(nm).min() < 1.0 else None
        if step:
            whole = np.arange(np.ceil(nm[0]), min(nm[-1], LAST_NM))
            nm, response = whole, np.interp(whole, nm, response)
        keep = np.flatnonzero(response > SMALLEST * response.max())
        part = slice(max(keep[0] - 1, 0), keep[-1] + 2)
        rows += [[name, f"{x:g}", f"{y:.5g}"] for x, y in zip(nm[part], response[part], strict=True)]
    return rows


def vega_rows(path: Path) -> list[list[str]]:
    with fits.open(path) as found:
        table = found[1].data
        nm = np.asarray(table["WAVELENGTH"], float) / 10.0
        flux = np.asarray(table["FLUX"], float) * 1e-2  # erg s-1 cm-2 A-1 to W m-2 nm-1
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(nm) * (flux[1:] + flux[:-1]))])
    edges = np.arange(279.5, LAST_NM + 1.0)
    mean = np.diff(np.interp(edges, nm, cumulative))
    return [[f"{x:g}", f"{y:.5e}"] for x, y in zip(edges[:-1] + 0.5, mean, strict=True)]


def alpha_opic_rows(path: Path) -> list[list[str]]:
    rows = []
    with path.open(encoding="utf-8-sig") as stream:
        for row in list(csv.reader(stream))[1:]:
            rows.append([row[0].strip(), *(f"{float(x):.6g}" if x.strip() else "0" for x in row[1:6])])
    return rows


def sqm_rows(path: Path) -> list[list[str]]:
    return [line.split() for line in path.read_text(encoding="utf-8").splitlines()[1:] if line.strip()]


def write(name: str, head: str, columns: str, rows: list[list[str]]) -> None:
    text = "".join(f"# {line}\n" for line in head.strip().splitlines())
    text += columns + "\n" + "".join(",".join(row) + "\n" for row in rows)
    (FOLDER / name).write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("--vega", "--alpha-opic", "--sqm"):
        parser.add_argument(option, type=Path, required=True)
    args = parser.parse_args()
    write("bands.csv", BANDS_HEAD, "band,wavelength_nm,response", band_rows())
    write("vega.csv", VEGA_HEAD, "wavelength_nm,irradiance", vega_rows(args.vega))
    columns = "wavelength_nm,s_cone_opic,m_cone_opic,l_cone_opic,rhodopic,melanopic"
    write("alpha_opic.csv", ALPHA_OPIC_HEAD, columns, alpha_opic_rows(args.alpha_opic))
    write("sqm.csv", SQM_HEAD, "wavelength_nm,response", sqm_rows(args.sqm))


if __name__ == "__main__":
    main()
