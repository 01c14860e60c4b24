"""Spectra become numbers: quantities by name, each with its unit, its source and what it is of.

Magnitudes, light as eyes and skins see it, photons, colour; integrated at 1 nm.  The factor of a spectrum over the
sun's is smooth in wavelength and is interpolated in the logarithm; the solar spectrum at 1 nm and the response are
multiplied in afterwards (`twilight.numerics.spectrum`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from twilight.base.conventions import LEAST_LUMINANCE
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.quantities import responses as respond

Of = Literal["direction", "surface"]
MESOPIC_RATIO = 683.0 / 1699.0
"""V'(555 nm) as CIE 191:2010 has it."""
MESOPIC_OFFSET = 0.7670
"""m at 1 cd m^-2 (CIE 191:2010)."""
MESOPIC_PER_DECADE = 0.3334
"""Change of m for a factor of ten in luminance (CIE 191:2010)."""
NEWTON_STEPS = 6
"""Newton steps for the equation of m: m is within 1e-15 for scotopic over photopic light 0.5 to 6, 0.005 at 0.1."""


def adaptation_coefficient(photopic: np.ndarray, scotopic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """m of CIE 191:2010 (0: night vision, 1: day vision) and the mesopic luminance [cd m^-2] for luminances of one
    shape; photopic and scotopic [cd m^-2]."""
    p, s = (np.maximum(np.asarray(light, float), LEAST_LUMINANCE) for light in (photopic, scotopic))
    m = np.full(np.broadcast_shapes(p.shape, s.shape), 0.5)
    for _ in range(NEWTON_STEPS):
        light, weight = m * p + (1.0 - m) * s * MESOPIC_RATIO, m + (1.0 - m) * MESOPIC_RATIO
        next_m = np.clip(MESOPIC_OFFSET + MESOPIC_PER_DECADE * np.log10(light / weight), 0.0, 1.0)
        slope = MESOPIC_PER_DECADE / np.log(10.0) * ((p - s * MESOPIC_RATIO) / light - (1.0 - MESOPIC_RATIO) / weight)
        inside = (next_m > 0.0) & (next_m < 1.0)
        m = np.clip(m + (next_m - m) / np.where(inside, np.maximum(1.0 - slope, 0.5), 1.0), 0.0, 1.0)
    return m, (m * p + (1.0 - m) * s * MESOPIC_RATIO) / (m + (1.0 - m) * MESOPIC_RATIO)


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

    def responses(self) -> list[respond.Response]:
        """The responses that wavelengths must cover."""
        return [respond.response(one) for one in self.needs]


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
        *(_receptor(name) for name in respond.ALPHA_OPIC),
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
        curve = respond.response(band)
    except TwilightError as error:
        raise TwilightError(f"quantity: {error}; or one of {', '.join(QUANTITIES)}") from None
    if system not in ("", "AB", "Vega"):
        raise TwilightError(f"quantity: {name}: the system '{system}' is not known; AB and Vega are")
    usual = system or curve.system
    return Quantity(
        name,
        f"magnitude_{_word(curve.name)}{'_' + system.lower() if system else ''}_per_arcsec2",
        "mag arcsec-2",
        ("direction",),
        (curve,),
        lambda light: light.magnitude(curve, usual),
        f"surface brightness in {curve.name} ({usual}; {curve.source})",
    )


def _within(kind: str, name: str) -> Quantity:
    curve = respond.response(name)
    if kind == "photons":
        unit, text = "s-1 m-2", "photons"
        return Quantity(
            f"photons:{name}", f"photons_{_word(curve.name)}_per_s_m2", unit, _BOTH, (curve,),
            lambda light: light.photons(curve), f"{text} within {curve.name} ({curve.source})",
        )  # fmt: skip
    return Quantity(
        f"in:{name}", f"light_in_{_word(curve.name)}_w_per_m2", "W m-2", _BOTH, (curve,),
        lambda light: light.within(curve), f"energy within {curve.name} ({curve.source})",
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


MAX_UNCOVERED = 0.04
"""Largest fraction of a response, weighted with sunlight, beyond the sampled wavelengths, where the spectrum is
continued as a power of the wavelength; that is wrong by some tenth of itself in the air's windows."""
ARCSEC2_SR = (np.pi / 648000.0) ** 2
"""One square arcsecond [sr]."""
VEGA_MAGNITUDE = 0.023
"""Of Vega in every band of the Vega system: its V (Bohlin 2007, ASP Conf. Ser. 364, 315), all its colours 0."""
AB_JANSKY = 3631.0
"""Flux density of AB magnitude 0 [Jy] (Oke & Gunn 1983)."""
_LIGHT_NM_PER_S = 2.99792458e17
"""Speed of light (SI 2019)."""
_PHOTON_J_NM = 6.62607015e-34 * _LIGHT_NM_PER_S
"""h c [J nm] (SI 2019)."""
_AVOGADRO = 6.02214076e23
"""Particles in a mole (SI 2019)."""
ALPHA_OPIC_D65_W_PER_LM = dict(
    zip(respond.ALPHA_OPIC, (0.8173e-3, 1.4558e-3, 1.6289e-3, 1.4497e-3, 1.3262e-3), strict=True)
)
"""Efficacy of luminous radiation of daylight D65 for the five receptors, CIE S 026:2018 table 1 [W lm^-1]."""
UV_INDEX_M2_PER_W = 40.0
"""UV index of erythemal irradiance (WHO 2002; ISO/CIE 17166:2019)."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Spectra of radiance or irradiance over those of the sun.

    factor (..., W): over the solar irradiance at distance_au [sr^-1 or 1]; wavelength_nm (W,); solar_spectrum: one of
    `spectrum.solar_spectra()`; where: what errors call the wavelengths.
    """

    factor: np.ndarray
    wavelength_nm: np.ndarray
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM
    distance_au: float = 1.0
    where: str = "the sky"

    def weighted(self, which: respond.Response, weight: np.ndarray | None = None) -> np.ndarray:
        """Integral of light times a response over wavelength, (...): of energy in W m^-2 (sr^-1) where the response is
        to energy, with the wavelength [nm] as a factor where it is to photons; weight (G,): at its `grid_nm`, in place
        of its own.

        Errors: TwilightError where more than MAX_UNCOVERED of the response is beyond the wavelengths.
        """
        check_covered(which, self.wavelength_nm, self.where)
        grid = which.grid_nm
        given = which.energy_weight() if weight is None else weight
        weights = given * _trapezoid(grid.size) * spectrum.solar_at(grid, self.solar_spectrum, self.distance_au)
        return spectrum.integrate(self.factor, self.wavelength_nm, weights, grid)

    def within(self, which: object) -> np.ndarray:
        """Energy within a response, integral of L R over wavelength [W m^-2 (sr^-1)], (...)."""
        curve = respond.response(which)
        return self.weighted(curve, curve.on_grid())

    def photons(self, which: object) -> np.ndarray:
        """Photons within a response, integral of L R wavelength / (h c) [s^-1 m^-2 (sr^-1)], (...)."""
        curve = respond.response(which)
        return self.weighted(curve, curve.on_grid() * curve.grid_nm) / _PHOTON_J_NM

    def magnitude(self, band: object, system: str | None = None) -> np.ndarray:
        """Surface brightness of a radiance [mag arcsec^-2], (...); infinite where there is no light.

        band: as of `responses.response`; system: AB, Vega, or None for what is usual with the band.
        """
        curve = respond.response(band)
        with np.errstate(divide="ignore"):
            return -2.5 * np.log10(self.weighted(curve) * ARCSEC2_SR / zero_point(curve, system))

    def photopic(self) -> np.ndarray:
        """Luminance [cd m^-2] or illuminance [lx] by V(lambda) of the 2 deg observer, (...)."""
        return spectrum.LUMINOUS_EFFICACY_LM_PER_W * self.weighted(respond.response("photopic"))

    def scotopic(self) -> np.ndarray:
        """Scotopic luminance [cd m^-2] or illuminance [lx] by V'(lambda) of CIE 1951, (...)."""
        return respond.SCOTOPIC_EFFICACY_LM_PER_W * self.weighted(respond.response("scotopic"))

    def mesopic(self) -> np.ndarray:
        """Mesopic luminance [cd m^-2] of an eye adapted to this very light, CIE 191:2010 (MES2), (...)."""
        return adaptation_coefficient(self.photopic(), self.scotopic())[1]

    def alpha_opic_edi(self, receptor: str) -> np.ndarray:
        """Equivalent daylight (D65) illuminance of a receptor [lx], CIE S 026:2018, (...)."""
        return self.weighted(respond.response(receptor)) / ALPHA_OPIC_D65_W_PER_LM[receptor]

    def ppfd(self) -> np.ndarray:
        """Photosynthetic photon flux density, 400 to 700 nm [umol m^-2 s^-1], (...)."""
        return self.photons("PAR") * 1e6 / _AVOGADRO

    def uv_index(self) -> np.ndarray:
        """UV index of an irradiance, (...): 40 m^2/W times the erythemal irradiance from 300 nm on."""
        return UV_INDEX_M2_PER_W * self.weighted(respond.response("erythema"))

    @cached_property
    def cct_duv(self) -> tuple[np.ndarray, np.ndarray]:
        """Correlated colour temperature [K] and distance from Planck's locus in (u, v) of CIE 1960, (...) each."""
        check_covered(respond.response("photopic"), self.wavelength_nm, self.where)
        functions = spectrum.colour_matching_functions("cie1931_2deg")
        sun = spectrum.solar_at_visible(self.solar_spectrum, self.distance_au)[:, None]
        return respond.correlated_colour_temperature(
            spectrum.integrate(self.factor, self.wavelength_nm, functions * sun)
        )


def zero_point(band: respond.Response, system: str | None = None) -> float:
    """Integral of response times the irradiance of magnitude 0 over wavelength, in the unit of `Spectra.weighted`.

    Errors: TwilightError for a system that is neither AB nor Vega.
    """
    chosen = system or band.system
    if chosen not in ("AB", "Vega"):
        raise TwilightError(f"magnitude: the system '{chosen}' is not known; AB and Vega are")
    return _zero_point(band, chosen)


@lru_cache(maxsize=256)
def _zero_point(band: respond.Response, system: str) -> float:
    nm = band.grid_nm
    if system == "AB":
        irradiance = AB_JANSKY * 1e-26 * _LIGHT_NM_PER_S / nm**2
    else:
        grid, of_vega = respond.vega()
        if nm[-1] > grid[-1]:
            raise TwilightError(
                f"magnitude: Vega is known to {grid[-1]:g} nm, and {band.name} reaches {nm[-1]:g} nm; take AB"
            )
        irradiance = of_vega[np.searchsorted(grid, nm)] * 10.0 ** (0.4 * VEGA_MAGNITUDE)
    return float((irradiance * band.energy_weight() * _trapezoid(nm.size)).sum())


def _trapezoid(count: int) -> np.ndarray:
    """Weights of the trapezoidal rule at a step of 1."""
    weight = np.ones(count)
    weight[[0, -1]] = 0.5
    return weight


def _sunlit_weight(which: respond.Response) -> np.ndarray:
    """A response to energy times the solar spectrum at `grid_nm`, with the weights of the trapezoidal rule, (G,)."""
    return which.energy_weight() * _trapezoid(which.grid_nm.size) * spectrum.solar_at(which.grid_nm)


def uncovered(which: respond.Response, wavelength_nm: np.ndarray) -> float:
    """Fraction of a response, weighted with sunlight, that is beyond the first and the last wavelength."""
    nm, weight = which.grid_nm, _sunlit_weight(which)
    inside = (nm >= wavelength_nm[0]) & (nm <= wavelength_nm[-1])
    return float(1.0 - weight[inside].sum() / weight.sum())


def needed_nm(which: respond.Response, most: float = MAX_UNCOVERED) -> tuple[float, float]:
    """The wavelengths [nm] that enclose all of a response but `most`, half of that on either side."""
    nm, weight = which.grid_nm, _sunlit_weight(which)
    below = np.cumsum(weight) / weight.sum()
    low, high = (nm[int(np.searchsorted(below, fraction))] for fraction in (0.5 * most, 1.0 - 0.5 * most))
    return float(low), float(high)


def check_covered(which: respond.Response, wavelength_nm: np.ndarray, where: str = "the sky") -> None:
    """Raise TwilightError where wavelengths do not cover a response, and say which would."""
    if uncovered(which, wavelength_nm) <= MAX_UNCOVERED:
        return
    low, high = needed_nm(which)
    there = " to ".join(f"{nm:g}" for nm in dict.fromkeys((wavelength_nm[0], wavelength_nm[-1])))
    raise TwilightError(
        f"{which.name}: {uncovered(which, wavelength_nm):.0%} of its light is beyond the wavelengths of {where}, "
        f"{there} nm; wavelengths from {np.floor(low):g} to {np.ceil(high):g} nm would cover it"
        + (" (twilight computes 300 to 1000 nm)" if low < 300.0 or high > 1000.0 else "")
    )


SAMPLES_NM = (
    *(300.0, 305.0, 310.0, 320.0, 330.0, 345.0, 354.0, 368.0, 382.0, 398.0, 432.0, 444.0, 484.0, 540.0, 560.0, 580.0),
    *(600.0, 620.0, 660.0, 684.0, 710.0, 756.0, 780.0, 788.0, 868.0, 888.0, 1000.0),
)
"""Wavelengths of which those are computed that a quantity needs, outside the bands of water vapour and oxygen but for
710 nm: by `benchmarks/wavelengths.py light` nearest to those of every 4 nm (wavelengths.csv)."""


def samples_for(responses: Sequence[respond.Response]) -> tuple[float, ...]:
    """Those of SAMPLES_NM that cover responses, and one more on either side where there is one.

    Errors: TwilightError for a response that they do not cover.
    """
    for asked in responses:
        check_covered(asked, np.array(SAMPLES_NM), "the air")
    ends = [needed_nm(asked) for asked in responses]
    low, high = min(a for a, _ in ends), max(b for _, b in ends)
    first = max(int(np.searchsorted(SAMPLES_NM, low, side="right")) - 1, 0)
    last = min(int(np.searchsorted(SAMPLES_NM, high)), len(SAMPLES_NM) - 1)
    return SAMPLES_NM[first : last + 1]
