"""Sets of coefficients of Preetham's sky: his own, and those of fits, from files of one layout.

A set is a YAML (or JSON) file with the keys

    version: 1
    name, source: text
    turbidity: [lowest, highest]            sun_zenith_deg: [lowest, highest]
    luminance: {distribution: {A, B, C, D, E}, zenith_kcd_per_m2: {slope, constant, chi}}
    x: {distribution: {A, B, C, D, E}, zenith: four lists}
    y: likewise

Every list is a polynomial in the turbidity T, highest power first.  The zenith luminance is slope tan(chi (pi - 2 z)) +
constant, z the sun's zenith angle [rad]; the zenith's x and y are polynomials in z whose coefficients, z^3 first, are
the four lists.  Everything else in the file is for people.

The five-parameter sky of Perez, Seals and Michalsky 1993, as Preetham 1999 eq. 3 has it, and the CIE's form.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field

from twilight.base.document import MAX_BYTES, parse_yaml
from twilight.base.errors import TwilightError
from twilight.base.reading import read_text
from twilight.base.sections import Number, Origins, Section, validate

LOWEST_COSINE = 1e-3
"""exp(B / cos zenith) is held below this cosine (0.06 deg above the horizon), where B < 0 has made it 0."""


def angles(sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
    """Cosine of the zenith angle, and the angle to the sun [rad], of directions; azimuth from the sun [deg].

    The angle comes from the chord, 2 arcsin(|d - s| / 2), which keeps its digits beside the sun.
    """
    e, a = np.radians(np.asarray(elevation_deg, float)), np.radians(np.asarray(azimuth_deg, float))
    s = np.radians(sun_elevation_deg)
    chord = (np.cos(e) * np.cos(a) - np.cos(s)) ** 2 + (np.cos(e) * np.sin(a)) ** 2 + (np.sin(e) - np.sin(s)) ** 2
    return np.sin(e) + 0.0 * a, 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord), 1.0))


def perez(parameters, cos_zenith, sun_angle_rad) -> np.ndarray:
    """F = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma), Preetham 1999 eq. 3.

    parameters: A, B, C, D, E; cos_zenith of the direction, > 0; sun_angle_rad: gamma, between direction and sun.
    """
    a, b, c, d, e = parameters
    gradation = 1.0 + a * np.exp(b / np.maximum(cos_zenith, LOWEST_COSINE))
    return gradation * (1.0 + c * np.exp(d * sun_angle_rad) + e * np.cos(sun_angle_rad) ** 2)


def perez_ratio(parameters, sun_zenith_rad: float, cos_zenith, sun_angle_rad) -> np.ndarray:
    """F(theta, gamma) / F(0, sun_zenith): 1 in the zenith (eq. 4)."""
    return perez(parameters, cos_zenith, sun_angle_rad) / perez(parameters, 1.0, sun_zenith_rad)


def cie(parameters, cos_zenith, sun_angle_rad) -> np.ndarray:
    """phi(Z) f(chi) of CIE S 011/E:2003 (ISO 15469:2004) with its parameters a, b, c, d, e.

    phi = 1 + a exp(b / cos Z), f = 1 + c (exp(d chi) - exp(d pi / 2)) + e cos^2 chi.
    """
    a, b, c, d, e = parameters
    gradation = 1.0 + a * np.exp(b / np.maximum(cos_zenith, LOWEST_COSINE))
    indicatrix = 1.0 + c * (np.exp(d * sun_angle_rad) - np.exp(0.5 * np.pi * d)) + e * np.cos(sun_angle_rad) ** 2
    return gradation * indicatrix


def traditional_overcast(cos_zenith) -> np.ndarray:
    """(1 + 2 cos theta) / 3 relative to the zenith: Moon and Spencer 1942, CIE 1955, CIE S 011 type 16, eq. 2."""
    return (1.0 + 2.0 * np.maximum(cos_zenith, 0.0)) / 3.0


def overcast_illuminance_lx(sun_elevation_deg: float) -> float:
    """Horizontal illuminance of an overcast sky [lx], 300 + 21000 sin(elevation) (Krochmann and Seidl 1974)."""
    return 300.0 + 21000.0 * float(np.sin(np.radians(sun_elevation_deg)))


def overcast_luminance(sun_elevation_deg: float, cos_zenith) -> np.ndarray:
    """Luminance [cd m^-2] of the traditional overcast sky; its zenith is 9/(7 pi) of the horizontal illuminance."""
    zenith = 9.0 / (7.0 * np.pi) * overcast_illuminance_lx(sun_elevation_deg)
    return zenith * traditional_overcast(cos_zenith)


PARAMETERS = ("A", "B", "C", "D", "E")
"""Parameters of a Perez distribution."""
QUANTITIES = ("luminance", "x", "y")
"""What a set of coefficients describes: luminance and CIE 1931 chromaticity."""
ZENITH_LUMINANCE = ("slope", "constant", "chi")
"""Polynomials of the zenith luminance."""
_PREFIX = "perez_"
"""First letters of the files of shipped sets."""
LARGEST = 1e100
"""Largest number of a set: a whole number may be too large for a float, a polynomial of larger floats overflows."""


@dataclass(frozen=True)
class SkyCoefficients:
    """Distribution and zenith of luminance and chromaticity x, y for a range of turbidities and sun positions.

    distribution: for each of `luminance`, `x`, `y` five polynomials in the turbidity (A to E), highest power first.
    zenith: for `luminance` the polynomials slope, constant and chi [kcd m^-2]; for `x` and `y` four, of the powers 3 to
        0 of the sun's zenith angle [rad].
    """

    name: str
    source: str
    turbidity: tuple[float, float]
    sun_zenith_deg: tuple[float, float]
    distribution: Mapping[str, tuple[tuple[float, ...], ...]]
    zenith: Mapping[str, tuple[tuple[float, ...], ...]]

    def parameters(self, quantity: str, turbidity: float) -> np.ndarray:
        """A, B, C, D, E of one of `luminance`, `x`, `y`."""
        return np.array([np.polyval(p, turbidity) for p in self.distribution[quantity]])

    def zenith_luminance_cd_per_m2(self, sun_zenith_deg, turbidity: float) -> np.ndarray:
        """Y_z = slope tan(chi (pi - 2 z)) + constant, in cd m^-2."""
        slope, constant, chi = (np.polyval(p, turbidity) for p in self.zenith["luminance"])
        return 1000.0 * (slope * np.tan(chi * (np.pi - 2.0 * np.radians(sun_zenith_deg))) + constant)

    def zenith_chromaticity(self, sun_zenith_deg, turbidity: float) -> tuple[np.ndarray, np.ndarray]:
        """CIE 1931 x and y of the zenith."""
        z = np.radians(sun_zenith_deg)
        x, y = (np.polyval([np.polyval(p, turbidity) for p in self.zenith[q]], z) for q in ("x", "y"))
        return x, y

    def sky(self, turbidity: float, sun_elevation_deg: float, elevation_deg, azimuth_deg):
        """Luminance [cd m^-2] and CIE 1931 x, y of directions at or above the horizon; azimuth from the sun."""
        cosine, gamma = angles(sun_elevation_deg, elevation_deg, azimuth_deg)
        sun_zenith = np.radians(90.0 - sun_elevation_deg)
        zenith = (
            self.zenith_luminance_cd_per_m2(90.0 - sun_elevation_deg, turbidity),
            *self.zenith_chromaticity(90.0 - sun_elevation_deg, turbidity),
        )
        return tuple(
            value * perez_ratio(self.parameters(quantity, turbidity), float(sun_zenith), cosine, gamma)
            for quantity, value in zip(QUANTITIES, zenith, strict=True)
        )

    def as_document(self) -> dict[str, Any]:
        """The set as its file has it, numbers to 7 digits."""

        def rounded(values: tuple[float, ...]) -> list[float]:
            return [float(f"{v:.7g}") for v in values]

        made: dict[str, Any] = {
            "version": 1,
            "name": self.name,
            "source": self.source,
            "turbidity": list(self.turbidity),
            "sun_zenith_deg": list(self.sun_zenith_deg),
        }
        for q in QUANTITIES:
            parameters = zip(PARAMETERS, map(rounded, self.distribution[q]), strict=True)
            made[q] = {"distribution": dict(parameters), "zenith": [rounded(row) for row in self.zenith[q]]}
        rows = made["luminance"].pop("zenith")
        made["luminance"]["zenith_kcd_per_m2"] = dict(zip(ZENITH_LUMINANCE, rows, strict=True))
        return made

    @np.errstate(all="ignore")  # what overflows is not finite, and found
    def check(self, where: str) -> None:
        """Raise TwilightError where a luminance is not positive or a chromaticity not one, anywhere in the range."""
        elevation, azimuth = np.meshgrid([0.0, 1.0, 3.0, 10.0, 30.0, 60.0, 90.0], np.linspace(0.0, 180.0, 13))
        for turbidity in np.linspace(*self.turbidity, 9):
            for quantity in QUANTITIES:
                b = self.parameters(quantity, turbidity)[1]
                if b > 0:
                    raise TwilightError(
                        f"{where}: {quantity}.distribution.B is {b:g} at turbidity {turbidity:g}; "
                        "it must not be positive, or the horizon would be infinitely bright"
                    )
            for sun_zenith in np.linspace(*self.sun_zenith_deg, 13):
                y_z, x, y = self.sky(turbidity, 90.0 - sun_zenith, elevation, azimuth)
                fault = ""
                if not (np.isfinite(y_z).all() and (y_z > 0).all()):
                    fault = "a luminance that is not positive"
                elif not ((x > 0).all() and (y > 0).all() and (x + y < 1).all()):
                    fault = "a chromaticity outside 0 to 1"
                if fault:
                    raise TwilightError(
                        f"{where}: gives {fault} at turbidity {turbidity:g} and sun zenith angle {sun_zenith:g} deg"
                    )


def shipped_sets() -> list[str]:
    """Names of the sets that come with twilight."""
    folder = resources.files("twilight").joinpath("data/analytic")
    names = [entry.name for entry in folder.iterdir() if entry.name.startswith(_PREFIX)]
    return sorted(name.removeprefix(_PREFIX).removesuffix(".yaml") for name in names)


def load_coefficients(name: str) -> SkyCoefficients:
    """The shipped set of that name, or the one in the file (.yaml, .yml or .json) of that path.

    Raises TwilightError for a set that does not exist, cannot be read, or gives a sky that cannot be.
    """
    if name in shipped_sets():
        return _shipped(name)
    path = Path(name)
    if path.suffix not in (".yaml", ".yml", ".json"):
        raise TwilightError(
            f"solver.coefficients is {name}; allowed are {', '.join(shipped_sets())} and the path of a .yaml or "
            ".json file"
        )
    return parse_coefficients(read_text(path, MAX_BYTES), str(path))


def file_sha256(name: str) -> str:
    """SHA-256 of the file of that path, hexadecimal; empty for a shipped set, which the program's version names."""
    if name in shipped_sets():
        return ""
    load_coefficients(name)  # says what is wrong with the file
    return hashlib.sha256(Path(name).read_bytes()).hexdigest()


@lru_cache(maxsize=8)
def _shipped(name: str) -> SkyCoefficients:
    text = resources.files("twilight").joinpath(f"data/analytic/{_PREFIX}{name}.yaml").read_text(encoding="utf-8")
    return parse_coefficients(text, name)


_Polynomial = Annotated[
    tuple[Annotated[Number, Field(ge=-LARGEST, le=LARGEST)], ...], Field(min_length=1, max_length=5)
]


class _Part(Section):
    model_config = ConfigDict(extra="ignore")


class _Distribution(_Part):
    A: _Polynomial
    B: _Polynomial
    C: _Polynomial
    D: _Polynomial
    E: _Polynomial


class _ZenithLuminance(_Part):
    slope: _Polynomial
    constant: _Polynomial
    chi: _Polynomial


class _Luminance(_Part):
    distribution: _Distribution
    zenith_kcd_per_m2: _ZenithLuminance


class _Chromaticity(_Part):
    distribution: _Distribution
    zenith: tuple[_Polynomial, _Polynomial, _Polynomial, _Polynomial]


def _rises(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError("must be two numbers that do not fall")
    return value


_Turbidity = Annotated[Number, Field(ge=1.0, le=100.0)]
_Zenith = Annotated[Number, Field(ge=0.0, le=90.0)]


class _File(_Part):
    """A file of coefficients; what else is in it is for people."""

    version: Literal[1]
    name: str | None = None
    source: str = ""
    turbidity: Annotated[tuple[_Turbidity, _Turbidity], AfterValidator(_rises)]
    sun_zenith_deg: Annotated[tuple[_Zenith, _Zenith], AfterValidator(_rises)]
    luminance: _Luminance
    x: _Chromaticity
    y: _Chromaticity


def parse_coefficients(text: str, where: str) -> SkyCoefficients:
    """A set from the text of its file; TwilightError that names ``where`` and the key otherwise."""
    file = validate(_File, parse_yaml(text, where), Origins({(): where}))
    made = SkyCoefficients(
        name=file.name or where,
        source=file.source,
        turbidity=file.turbidity,
        sun_zenith_deg=file.sun_zenith_deg,
        distribution={q: _values(getattr(file, q).distribution) for q in QUANTITIES},
        zenith={"luminance": _values(file.luminance.zenith_kcd_per_m2), "x": file.x.zenith, "y": file.y.zenith},
    )
    made.check(where)
    return made


def _values(section: Section) -> tuple[tuple[float, ...], ...]:
    return tuple(value for _, value in section)
