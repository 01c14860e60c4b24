"""Spectral responses: bands of photometry, receptors of the eye, action spectra, cameras, and curves of a user's own.

Correlated colour temperature and Duv are the nearest point of Planck's locus in (u, v) of CIE 1960 (Ohno 2014, Leukos
10, 47): the foot of the perpendicular on the locus, here on a table that is fine enough for its arcs to be straight;
360 to 830 nm, second radiation constant 1.4388e-2 m K (CIE 015:2018).
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.csv_columns import as_number, delimiter_of, fields_of, numbered_lines
from twilight.base.arguments import in_units, plain
from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.shipped_data import data_numbers, data_rows
from twilight.numerics import spectrum

JOHNSON_COUSINS = ("U", "B", "V", "R", "I")
ALPHA_OPIC = ("s_cone_opic", "m_cone_opic", "l_cone_opic", "rhodopic", "melanopic")
"""The five of CIE S 026:2018."""
CAMERA = "nikon_5100"
"""The camera of data/colour/spectra.csv whose channels are `camera-red`, `camera-green`, `camera-blue`."""
ERYTHEMA_NM = np.arange(300.0, 401.0)
"""Where erythema is counted [nm]: the air's data begin at 300 nm, and some 1 to 5 % of a high sun's is below."""
SCOTOPIC_EFFICACY_LM_PER_W = 1700.06
"""Luminous efficacy at the maximum of V'(lambda), 683 lm/W at 555.016 nm (CIE 018:2019)."""


@in_units
@dataclass(frozen=True, eq=False)
class Response:
    """A relative spectral response, linear between its samples and 0 beyond them.

    wavelength_nm (R,): increasing; value (R,): not negative; per: whether `value` counts the energy of light or its
    photons; system: magnitudes that are usual with it, AB or Vega; source: where the curve is from.
    """

    name: str
    wavelength_nm: np.ndarray
    value: np.ndarray
    per: Literal["energy", "photon"] = "energy"
    system: Literal["AB", "Vega"] = "AB"
    source: str = ""

    def __post_init__(self) -> None:
        # a change of unit leaves a rounding beside whole numbers
        nm, value = np.round(np.asarray(self.wavelength_nm, float), 6), np.asarray(self.value, float)
        object.__setattr__(self, "wavelength_nm", nm)
        object.__setattr__(self, "value", value)
        what = f"response {self.name}"
        if nm.ndim != 1 or nm.shape != value.shape or nm.size < 2:
            raise TwilightError(f"{what}: needs as many values as wavelengths, two or more")
        if not (np.isfinite(nm).all() and np.isfinite(value).all() and (np.diff(nm) > 0).all()):
            raise TwilightError(f"{what}: wavelengths must increase, and all numbers must be finite")
        if (value < 0).any() or not value.any():
            raise TwilightError(f"{what}: values must not be negative, and not all 0")
        grid, _ = spectrum.solar_spectrum()
        if nm[-1] <= grid[0] or nm[0] >= grid[-1]:
            raise TwilightError(
                f"{what}: lies from {nm[0]:g} to {nm[-1]:g}; wavelengths are in nm, from {grid[0]:g} to {grid[-1]:g}"
            )

    @property
    def grid_nm(self) -> np.ndarray:
        """Whole nanometres over which it is integrated, (G,), within the solar spectrum."""
        solar, _ = spectrum.solar_spectrum()
        first, last = np.round(
            self.wavelength_nm[[0, -1]], 6
        )  # a change of unit leaves a rounding beside whole numbers
        return np.arange(max(np.floor(first), solar[0]), min(np.ceil(last), solar[-1]) + 1.0)

    def on_grid(self) -> np.ndarray:
        """`value` at `grid_nm`, (G,)."""
        return np.interp(self.grid_nm, self.wavelength_nm, self.value, left=0.0, right=0.0)

    def energy_weight(self) -> np.ndarray:
        """Its response to energy at `grid_nm`, (G,); of a response to photons with the wavelength [nm] as a factor."""
        return self.on_grid() * self.grid_nm if self.per == "photon" else self.on_grid()


@lru_cache(maxsize=1)
def _bands() -> dict[str, Response]:
    curves: dict[str, list[tuple[float, float]]] = {}
    for row in data_rows("photometry/bands.csv"):
        curves.setdefault(row["band"], []).append((float(row["wavelength_nm"]), float(row["response"])))
    out = {}
    for name, pairs in curves.items():
        nm, value = np.array(pairs).T
        johnson = name in JOHNSON_COUSINS
        system: Any = "Vega" if johnson or name.startswith("gaia") else "AB"
        source = "Bessell 1990" if johnson else "DR3, Riello et al. 2021" if system == "Vega" else (
            "Doi et al. 2010" if name.startswith("sdss") else "LSST throughputs 1.9")  # fmt: skip
        out[name] = Response(name, nm, value, "energy" if johnson else "photon", system, source)
    nm, value = data_numbers("photometry/sqm.csv")[1].T
    out["SQM"] = Response("SQM", nm, value, "energy", "Vega", "Illumina's sqm.dat")
    return out


@lru_cache(maxsize=1)
def _receptors() -> dict[str, Response]:
    nm, *columns = data_numbers("photometry/alpha_opic.csv")[1].T
    receptors = {
        name: Response(name, nm, column, source="CIE S 026:2018")
        for name, column in zip(ALPHA_OPIC, columns, strict=True)
    }
    photopic = spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    receptors["photopic"] = Response("photopic", spectrum.VISIBLE_NM, photopic, source="CIE 018:2019")
    receptors["PAR"] = Response(
        "PAR", np.array([400.0, 700.0]), np.ones(2), "photon", source="400 to 700 nm, McCree 1972"
    )
    receptors["erythema"] = Response("erythema", ERYTHEMA_NM, erythema(ERYTHEMA_NM), source="ISO/CIE 17166:2019")
    return receptors


def erythema(wavelength_nm: np.ndarray) -> np.ndarray:
    """Action spectrum of sunburn: 1 to 298 nm, 10^(0.094 (298 - nm)) to 328, 10^(0.015 (140 - nm)) to 400 (CIE)."""
    nm = np.asarray(wavelength_nm, float)
    value = np.where(nm <= 328.0, 10.0 ** (0.094 * (298.0 - nm)), 10.0 ** (0.015 * (140.0 - nm)))
    return np.where(nm <= 298.0, 1.0, np.where(nm <= 400.0, value, 0.0))


@lru_cache(maxsize=1)
def scotopic_efficiency() -> np.ndarray:
    """V'(lambda) of the CIE 1951 scotopic observer at ``spectrum.VISIBLE_NM``, (471,)."""
    return spectrum.at_visible("scotopic")


@lru_cache(maxsize=1)
def _scotopic() -> Response:
    return Response("scotopic", spectrum.VISIBLE_NM, scotopic_efficiency(), source="CIE 1951")


@lru_cache(maxsize=3)
def _camera(channel: str) -> Response:
    nm, values = spectrum.colour_spectrum(f"{CAMERA} {channel}")
    return Response(f"camera-{channel}", nm, np.maximum(values, 0.0), source="Darrodi et al. 2015")


CAMERA_NAMES = ("camera-red", "camera-green", "camera-blue")


def names() -> list[str]:
    """Names of the responses that come with the program; beside them, those of speclite, e.g. decam2014-g."""
    return [*_bands(), *_receptors(), "scotopic", *CAMERA_NAMES]


ResponseLike = Response | str | Path | tuple[ArrayLike, ArrayLike] | list[ArrayLike]
"""What `response` takes: a name, a file, or wavelengths [nm] and values."""


def response(which: Any) -> Response:
    """A response by its name, file, or arrays.

    which: one of `names`; a name of speclite's such as decam2014-g (needs that package); the path of a CSV with the
    columns wavelength [nm] and response to energy; a pair of arrays of the same; or a `Response`.
    Errors: TwilightError for a name that is not known, and a curve that is none.
    """
    if isinstance(which, Response):
        return which
    if isinstance(which, str | Path):
        return _named(str(which))
    if isinstance(which, tuple | list) and len(which) == 2:
        return Response("own", plain(which[0], "wavelength_nm"), plain(which[1], "response"), source="given")
    raise TwilightError(f"response: must be a name, a CSV file, or (wavelengths, values), got {type(which).__name__}")


@lru_cache(maxsize=256)
def _named(name: str) -> Response:
    for table in (_bands(), _receptors()):
        if name in table:
            return table[name]
    if name == "scotopic":
        return _scotopic()
    if name in CAMERA_NAMES:
        return _camera(name.partition("-")[2])
    if name.lower().endswith(".csv"):
        return _file(Path(name))
    group, dash, _ = name.partition("-")
    if dash and group and "/" not in name:
        return _from_speclite(name)
    near = get_close_matches(name, names(), 1, 0.6)
    meant = f" (did you mean {near[0]}?)" if near else ""
    raise TwilightError(
        f"the band '{name}' is not known{meant}; choose one of {', '.join(names())}, one of speclite's such as "
        "decam2014-g, or a CSV file of wavelength [nm] and response"
    )


def _from_speclite(name: str) -> Response:
    if not is_installed("speclite"):
        raise missing("speclite", f"the band '{name}', none of {', '.join(names())},")
    from speclite import filters  # optional

    try:
        curve = filters.load_filter(name)
    except ValueError:
        raise TwilightError(f"the band '{name}' is neither one of {', '.join(names())} nor one of speclite's") from None
    nm = np.asarray(curve.wavelength, float) / 10.0
    return Response(name, nm, np.asarray(curve.response, float), "photon", "AB", "speclite")


def _file(path: Path) -> Response:
    lines = numbered_lines(path)
    delimiter = delimiter_of(lines[0][1]) if lines else ","
    pairs: list[tuple[float, float]] = []
    for i, (number, line) in enumerate(lines):
        fields = fields_of(path, number, line, delimiter)
        try:
            if len(fields) != 2:
                raise ValueError
            pairs.append((as_number(fields[0], delimiter), as_number(fields[1], delimiter)))
        except ValueError:
            if i > 0:
                raise TwilightError(
                    f"{path}: line {number}: needs two numbers, wavelength [nm] and response to energy, with a comma "
                    "between them; or with a semicolon, where decimals have commas"
                ) from None
    if not pairs:
        raise TwilightError(f"{path}: needs two columns of numbers, wavelength [nm] and response to energy")
    nm, value = np.array(pairs).T
    return Response(path.stem, nm, value, source=str(path))


@lru_cache(maxsize=1)
def vega() -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] (step 1) and Vega's irradiance above the air [W m^-2 nm^-1], 280 to 1150 nm."""
    nm, irradiance = data_numbers("photometry/vega.csv")[1].T
    return nm, irradiance


RANGE_K = (1000.0, 1e5)
"""Temperatures of the table; light that is nearer to one of its ends than to any other point has none.  From 1e5 K to
infinity the locus goes on by 0.0024 in u, v, about what an eye can tell: 925,000 K says no more than that it is bluer
than any."""
STEP = 0.002
"""Relative step of the temperature in the table: found within 0.01 %."""
MAX_DUV = 0.05
"""Distance from the locus beyond which a colour temperature means nothing (CIE 015:2018)."""


def uv_1960(xyz: np.ndarray) -> np.ndarray:
    """(u, v) of CIE 1960 (..., 2) of XYZ (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(xyz, float), -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = x + 15.0 * y + 3.0 * z
        return np.stack([4.0 * x / total, 6.0 * y / total], axis=-1)


@lru_cache(maxsize=1)
def _locus() -> tuple[np.ndarray, np.ndarray]:
    """log of the temperature [K] (T,) and (u, v) (T, 2) of black bodies."""
    log_t = np.arange(np.log(RANGE_K[0]), np.log(RANGE_K[1]), STEP)
    nm = spectrum.VISIBLE_NM
    x = 1.4388e7 / nm[None, :] / np.exp(log_t)[:, None]
    body = (560.0 / nm) ** 5 / np.expm1(x)
    return log_t, uv_1960(body @ spectrum.colour_matching_functions("cie1931_2deg"))


def correlated_colour_temperature(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correlated colour temperature [K] and Duv of XYZ (..., 3), (...) each; Duv > 0 above the locus (greenish).

    NaN where there is no light, where Duv is beyond 0.05, and outside 1000 to 1e5 K; Duv itself is then kept.
    """
    from scipy.spatial import cKDTree  # start-up

    log_t, locus = _locus()
    uv = uv_1960(xyz).reshape(-1, 2)
    lit = np.isfinite(uv).all(axis=1)
    _, nearest = cKDTree(locus).query(np.where(lit[:, None], uv, 0.0))
    k = np.clip(nearest, 1, log_t.size - 2)
    best, temperature, duv = np.full(k.shape, np.inf), np.zeros(k.shape), np.zeros(k.shape)
    for first in (k - 1, k):
        a, b = locus[first], locus[first + 1]
        chord = b - a
        along = np.clip(((uv - a) * chord).sum(axis=1) / (chord**2).sum(axis=1), 0.0, 1.0)
        foot = a + along[:, None] * chord
        distance = np.hypot(*(uv - foot).T)
        # the locus runs from red to blue, towards smaller u: above it is to its right
        side = np.sign(chord[:, 1] * (uv - a)[:, 0] - chord[:, 0] * (uv - a)[:, 1])
        better = distance < best
        best = np.where(better, distance, best)
        temperature = np.where(better, np.exp(log_t[first] + along * STEP), temperature)
        duv = np.where(better, side * distance, duv)
    known = lit & (best <= MAX_DUV) & (nearest > 0) & (nearest < log_t.size - 1)
    shape = np.shape(xyz)[:-1]
    return np.where(known, temperature, np.nan).reshape(shape), np.where(lit, duv, np.nan).reshape(shape)
