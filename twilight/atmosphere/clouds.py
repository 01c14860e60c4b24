"""Clouds that cover the whole sky, the same from horizon to horizon: droplets, ice crystals, and noctilucent clouds.

Droplets and the grains of noctilucent clouds are spheres (Mie theory) of a gamma distribution of radii (Hansen and
Travis 1974, Space Sci. Rev. 16, 527, eq. 2.56), dN/dr ~ r^((1 - 3b)/b) exp(-r/(a b)), with a the effective radius and
b = 1/9 the effective variance, that of Deirmendjian's cloud C.1.  Cirrus is OPAC's first: hexagonal columns in random
orientation, which make halos of 22 and 46 deg (data/clouds/SOURCES.md); its phase function is known for unpolarised
light alone, so that light scattered by it counts as unpolarised.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.aerosols import AerosolRegion, MixtureOptics, mixture_of
from twilight.atmosphere.mie import Gamma
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers, data_rows
from twilight.numerics.phase import PhaseFunction

REFERENCE_NM = 550.0
"""Wavelength at which optical depths of clouds are given [nm]."""

EFFECTIVE_VARIANCE = 1.0 / 9.0
"""Of the radii of droplets and grains: cloud C.1 (Deirmendjian 1969), n(r) ~ r^6 exp(-6 r / r_mode)."""

CIRRUS_RADIUS_UM = 91.7
"""Effective radius of the crystals of cirrus [um], which is that of the tabulated phase function."""

MAX_DEPTH = 100.0
"""Largest optical depth of all clouds together: no solution was compared with others beyond."""


class CloudKind(NamedTuple):
    """What a kind of cloud is made of, and what it has unless something else is given.

    substance: of the spheres, `water` or `ice`; None: tabulated crystals
    base_km: above sea level, None: the ground; thickness_km; optical_depth at 550 nm; effective_radius_um
    """

    substance: str | None
    base_km: float | None
    thickness_km: float
    optical_depth: float
    effective_radius_um: float


KINDS: dict[str, CloudKind] = {
    "fog": CloudKind("water", None, 0.2, 5.0, 10.7),
    "stratus": CloudKind("water", 0.5, 0.5, 25.0, 7.33),
    "altostratus": CloudKind("water", 3.0, 1.0, 10.0, 7.33),
    "cirrus": CloudKind(None, 9.0, 1.5, 1.0, CIRRUS_RADIUS_UM),
    "noctilucent": CloudKind("ice", 82.4, 1.0, 1e-5, 0.05),
}
"""Radii of droplets: OPAC's continental stratus and fog (Hess et al. 1998).  Optical depths: in the ISCCP classes of
stratus (above 23), altostratus (3.6 to 23) and cirrus (below 3.6; Rossow and Schiffer 1999, Bull. Amer. Meteor. Soc.
80, 2261).  Altitudes: low, middle and high clouds of the International Cloud Atlas (WMO); noctilucent clouds around
82.9 km (Gadsden and Schroeder 1989), whose depth is that of 100 grains of 50 nm per cm^3."""


@dataclass(frozen=True)
class CloudLayer:
    """A homogeneous layer around the whole globe.

    kind: one of KINDS; base_km, top_km: above sea level; optical_depth: vertical, at 550 nm; effective_radius_um: of
    the spheres, that of the crystals for cirrus.
    """

    kind: str
    base_km: float
    top_km: float
    optical_depth: float
    effective_radius_um: float

    def region(self, wavelength_nm) -> AerosolRegion:
        """The layer at W wavelengths [nm]."""
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        optics = self._optics(wavelength)
        reference = self._optics(np.array([REFERENCE_NM])).extinction_per_km[0]
        per_km = self.optical_depth / (self.top_km - self.base_km) * optics.extinction_per_km / reference
        return AerosolRegion(
            f"{self.kind} cloud" if self.kind != "fog" else "fog",
            np.array([self.base_km, self.top_km]),
            np.stack([per_km, per_km]),
            np.stack([optics.single_scattering_albedo] * 2),
            np.ones((1, 2, wavelength.size)),
            (optics.phase,),
        )

    def _optics(self, wavelength: np.ndarray) -> MixtureOptics:
        substance = KINDS[self.kind].substance
        if substance is None:
            return cirrus_optics(wavelength)
        size = Gamma(self.effective_radius_um, EFFECTIVE_VARIANCE)
        return mixture_of([(1.0, size, refractive_index(substance, wavelength))], wavelength, name=self.kind)


def check_layers(layers: tuple[CloudLayer, ...], ground_km: float, top_km: float) -> None:
    """Raise TwilightError for a layer below the ground or above the air, and for more cloud than was ever compared."""
    for layer in layers:
        span = f"{layer.base_km:g} to {layer.top_km:g} km"
        if layer.base_km < ground_km or layer.top_km > top_km:
            raise TwilightError(
                f"clouds: {layer.kind} from {span} is not between the ground at {ground_km:g} km and the top of the "
                f"air at {top_km:g} km"
            )
    total = sum(layer.optical_depth for layer in layers)
    if total > MAX_DEPTH:
        raise TwilightError(
            f"clouds: the optical depths add up to {total:g}; allowed is {MAX_DEPTH:g}, up to which solutions were "
            "compared"
        )


@lru_cache(maxsize=1)
def _indices() -> dict[str, np.ndarray]:
    rows: dict[str, list[list[float]]] = {}
    for row in data_rows("clouds/refractive_indices.csv"):
        numbers = [float(row[key]) for key in ("wavelength_nm", "n_real", "n_imag")]
        rows.setdefault(row["substance"], []).append(numbers)
    return {name: np.array(values) for name, values in rows.items()}


def refractive_index(substance: str, wavelength_nm) -> np.ndarray:
    """n - ik of `water` or `ice` at wavelengths (W,) from 300 to 1000 nm: linear between the table's, k in its log."""
    nm, n, k = _indices()[substance].T
    return np.interp(wavelength_nm, nm, n) - 1j * np.exp(np.interp(wavelength_nm, nm, np.log(k)))


def cirrus_optics(wavelength_nm: np.ndarray) -> MixtureOptics:
    """Optics of OPAC's cirrus 1, which absorbs nothing and dims all wavelengths by the same factor.

    Between the table's wavelengths the logarithm of the phase function is linear, beyond them it is constant: there the
    forward peak, which is narrower than half a degree, is too wide or too narrow by a quarter.
    """
    names, rows = data_numbers("clouds/cirrus_phase.csv")
    table_nm = np.array([float(name) for name in names[1:]])
    place = np.interp(wavelength_nm, table_nm, np.arange(table_nm.size))
    low = np.minimum(place.astype(int), table_nm.size - 2)
    fraction = (place - low)[:, None]
    log_table = np.log(rows[:, 1:].T)
    phase = np.exp((1.0 - fraction) * log_table[low] + fraction * log_table[low + 1])
    phase_function = PhaseFunction.from_samples(np.radians(rows[:, 0]), phase, "cirrus")
    ones = np.ones(place.size)
    return MixtureOptics(ones, ones, phase_function)
