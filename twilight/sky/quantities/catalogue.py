"""Quantities by name, each with its unit, its source and what it is of: a direction or a surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.quantities.measure import Spectra
from twilight.sky.quantities.responses import ALPHA_OPIC, Response, response

Of = Literal["direction", "surface"]


@dataclass(frozen=True)
class Quantity:
    """A number of a spectrum.

    name: how it is asked for; variable: with its unit, for tables and datasets; unit: of CF; of: the light that it
    can be of; needs: names of its responses; value: from `Spectra` to an array; about: one line, with the source.
    """

    name: str
    variable: str
    unit: str
    of: tuple[Of, ...]
    needs: tuple[object, ...]
    value: Callable[[Spectra], np.ndarray]
    about: str

    def responses(self) -> list[Response]:
        """The responses that wavelengths must cover."""
        return [response(one) for one in self.needs]


def _eyes(name: str, variable: str, unit: str, of: Of, needs: tuple[str, ...], method: str, about: str) -> Quantity:
    return Quantity(name, variable, unit, (of,), needs, lambda light: getattr(light, method)(), about)


def _receptor(name: str) -> Quantity:
    about = f"equivalent daylight (D65) illuminance, {name.replace('_', '-')}, CIE S 026:2018"
    return Quantity(
        name, f"{name}_edi_lux", "lx", ("surface",), (name,), lambda light: light.alpha_opic_edi(name), about
    )


_BOTH: tuple[Of, ...] = ("direction", "surface")
QUANTITIES = {
    one.name: one
    for one in (
        _eyes("luminance", "luminance_cd_per_m2", "cd m-2", "direction", ("photopic",), "photopic",
              "photopic luminance, V(lambda) of CIE 1924"),
        _eyes("scotopic_luminance", "scotopic_luminance_cd_per_m2", "cd m-2", "direction", ("scotopic",), "scotopic",
              "scotopic luminance, V'(lambda) of CIE 1951"),
        _eyes("mesopic_luminance", "mesopic_luminance_cd_per_m2", "cd m-2", "direction", ("photopic", "scotopic"),
              "mesopic", "mesopic luminance, CIE 191:2010"),
        _eyes("illuminance", "illuminance_lux", "lx", "surface", ("photopic",), "photopic",
              "illuminance, V(lambda) of CIE 1924"),
        _eyes("scotopic_illuminance", "scotopic_illuminance_lux", "lx", "surface", ("scotopic",), "scotopic",
              "scotopic illuminance, V'(lambda) of CIE 1951"),
        *(_receptor(name) for name in ALPHA_OPIC),
        _eyes("ppfd", "ppfd_umol_per_m2_s", "umol m-2 s-1", "surface", ("PAR",), "ppfd",
              "photosynthetic photon flux density, 400 to 700 nm (McCree 1972)"),
        _eyes("uv_index", "uv_index", "1", "surface", ("erythema",), "uv_index",
              "UV index, ISO/CIE 17166:2019, from 300 nm on"),
        Quantity("cct", "cct_k", "K", _BOTH, ("photopic",), lambda light: light.cct_duv[0],
                 "correlated colour temperature (Ohno 2014)"),
        Quantity("duv", "duv", "1", _BOTH, ("photopic",), lambda light: light.cct_duv[1],
                 "distance from Planck's locus in (u, v) of CIE 1960 (Ohno 2014)"),
    )
}  # fmt: skip
"""The quantities that are no magnitude and no light within a response."""


def quantity(which: str | Quantity) -> Quantity:
    """A quantity by its name.

    which: one of `QUANTITIES`, in small letters or large; `in:NAME`, the energy within a response, and `photons:NAME`,
    its photons; else a band of `responses.response`, whose magnitude is meant, in AB or Vega with `NAME:AB`.
    Errors: TwilightError for a name that is none.
    """
    if isinstance(which, Quantity):
        return which
    name = str(which).strip()
    if name.lower().replace("-", "_") in QUANTITIES:
        return QUANTITIES[name.lower().replace("-", "_")]
    kind, colon, rest = name.partition(":")
    if colon and kind in ("in", "photons"):
        return _within(kind, rest)
    band, _, system = name.partition(":")
    try:
        found = response(band)
    except TwilightError as error:
        raise TwilightError(f"quantity: {error}; or one of {', '.join(QUANTITIES)}") from None
    if system not in ("", "AB", "Vega"):
        raise TwilightError(f"quantity: {name}: the system '{system}' is not known; AB and Vega are")
    usual = system or found.system
    return Quantity(
        name,
        f"magnitude_{_word(found.name)}{'_' + system.lower() if system else ''}_per_arcsec2",
        "mag arcsec-2",
        ("direction",),
        (found,),
        lambda light: light.magnitude(found, usual),
        f"surface brightness in {found.name} ({usual}; {found.source})",
    )


def _within(kind: str, name: str) -> Quantity:
    found = response(name)
    if kind == "photons":
        unit, text = "s-1 m-2", "photons"
        return Quantity(
            f"photons:{name}", f"photons_{_word(found.name)}_per_s_m2", unit, _BOTH, (found,),
            lambda light: light.photons(found), f"{text} within {found.name} ({found.source})",
        )  # fmt: skip
    return Quantity(
        f"in:{name}", f"light_in_{_word(found.name)}_w_per_m2", "W m-2", _BOTH, (found,),
        lambda light: light.within(found), f"energy within {found.name} ({found.source})",
    )  # fmt: skip


def _word(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name)


def unit_of(which: Quantity, of: Of) -> str:
    """The unit of a quantity; what is radiometric is per steradian of a direction."""
    radiometric = which.name.startswith(("in:", "photons:"))
    return f"{which.unit} sr-1" if radiometric and of == "direction" else which.unit


def check_of(which: Quantity, of: Of) -> None:
    """Raise TwilightError for a quantity that a direction, or a surface, does not have."""
    if of not in which.of:
        other = "a surface (horizontal, a plane, sphere or cylinder)" if of == "direction" else "a direction"
        twin = {"illuminance": "luminance", "scotopic_illuminance": "scotopic_luminance"}
        twin |= {value: key for key, value in twin.items()}
        hint = f"; {twin[which.name]} is the one of a {of}" if which.name in twin else ""
        raise TwilightError(f"quantity: {which.name} is of {other}, not of a {of}{hint}")
