"""Whether a medium is of the air that a compact model was fitted to: its aerosol load and ozone, or what differs.

A model stores what decides about the light in its air, each as a vertical column: optical depths, altitudes, albedo and
phase function of the particles, at its wavelengths and aerosol loads.  A medium's load and ozone are found from its
optical depths; then every column of it has to be that of the model's air with this load and ozone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twilight.atmosphere.levels import vertical_integral
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.solvers.compact.checks import check_medium
from twilight.solvers.compact.compact_sky import CompactSky

COMPARED_ANGLES_DEG = (5.0, 90.0, 170.0)
"""Scattering angles at which phase functions are compared [deg]."""

TOLERANCE = 0.02
"""Relative difference of a column up to which two media are of the same air."""

LEAST_DEPTH = 2e-4
"""Difference of a column, of optical depth for most, up to which two media are of the same air."""

LEAST_OZONE_DEPTH = 2e-3
"""Optical depth of the ozone where it absorbs most, below which its column cannot be read, nor matters."""

OUTSIDE_LOADS = 1e-3
"""How far beyond the loads of the model a load may be read, for rounding, relative to the largest."""

REFERENCE_NM = 550.0
"""Wavelength at which the aerosol load is an optical depth [nm]."""

PARTICLES = (
    "the aerosol's optical depth",
    "the aerosol's single scattering albedo",
    "the mean altitude of the aerosol",
    *(f"the aerosol's phase function at {angle:g} deg" for angle in COMPARED_ANGLES_DEG),
)
"""Rows of the array `particles`, as messages name them."""

AIR = ("the optical depth of the air's own scattering", "the mean altitude of the air's own scattering")
"""Rows of the array `air`, as messages name them."""

PLACE = ("the altitude of the ground", "the refractivity of the air at the ground")
"""Numbers of the array `place`, as messages name them."""


@dataclass(frozen=True)
class Recognised:
    """The aerosol optical depth at 550 nm and the ozone column [DU] of a medium; None: the model's own."""

    optical_depth_550nm: float
    ozone_column_du: float | None


def stored_air(
    loaded: Sequence[Medium], wavelength_nm: np.ndarray, without_ozone: np.ndarray, of_ozone: np.ndarray
) -> dict[str, np.ndarray]:
    """The columns of a model's air, as `CompactSky.air` holds them.

    loaded: the medium at each of the model's aerosol loads, at wavelengths of their own; wavelength_nm (W,): of the
    optical depths of gases without ozone, and of the reference column of ozone, (W,) each.
    """
    one = loaded[0]
    return {
        "particles_wavelength_nm": one.wavelength_nm,
        "particles": np.stack([_columns_of_particles(m) for m in loaded], axis=-1).astype(np.float32),
        "air": _air(one),
        "place": _place(one),
        "gases_wavelength_nm": wavelength_nm,
        "gases": np.stack([without_ozone, of_ozone]).astype(np.float32),
    }


def recognise(medium: Medium, model: CompactSky, name: str) -> Recognised:
    """The aerosol load and the ozone of a medium of the model's air.

    name: of the model, for errors.  Errors: TwilightError that says what differs from the model's air.
    """
    air = model.air
    if not air:
        raise TwilightError(
            f"the compact model {name} does not say of which air it is; fit it again: twilight fit compact"
        )
    _check_arrays(model, name)
    check_medium(medium, f"the compact model {name}", *model.wavelength_nm[[0, -1]])
    w, nodes = medium.wavelength_nm, air["particles_wavelength_nm"]
    columns = _columns_of_particles(medium)
    expected = np.stack([[np.interp(w, nodes, of) for of in row.T] for row in air["particles"].astype(float)])
    # the load: where the optical depth of the model's air is that of the medium
    at = int(np.argmin(np.abs(w - REFERENCE_NM)))
    loads = model.optical_depth_550nm
    depth, depths = float(columns[0, at]), expected[0, :, at]
    slack = OUTSIDE_LOADS * depths[-1]
    if not depths[0] - slack <= depth <= depths[-1] + slack:
        raise TwilightError(
            f"the compact model {name} has aerosol optical depths at 550 nm from {loads[0]:g} to {loads[-1]:g}, and "
            f"that of {medium.name or 'the medium'} at {w[at]:g} nm is {depth:.3g} (aerosol.optical_depth_550nm)"
        )
    load = float(np.interp(depth, depths, loads))
    at_load = np.array([[np.interp(load, loads, column) for column in row.T] for row in expected])
    for what, found, stored in zip(PARTICLES, _particles(columns), _particles(at_load), strict=True):
        _check_column(what, found, stored, w, name)
    for what, found, stored in zip(AIR, _air(medium), air["air"], strict=True):
        _check_column(what, found, np.exp(np.interp(np.log(w), np.log(nodes), np.log(stored))), w, name)
    for what, found, stored in zip(PLACE, _place(medium), air["place"], strict=True):
        _check_column(what, np.array([found]), np.array([stored]), w[:1], name)
    return Recognised(load, _ozone(medium, model, name))


def _check_arrays(model: CompactSky, name: str) -> None:
    """TwilightError unless the model's arrays of its air fit together."""
    air, loads = model.air, model.optical_depth_550nm.size
    nodes, gases = (np.asarray(air.get(f"{of}_wavelength_nm", np.zeros(0))).size for of in ("particles", "gases"))
    shapes = {
        "particles": (len(PARTICLES), nodes, loads),
        "air": (len(AIR), nodes),
        "place": (len(PLACE),),
        "gases": (2, gases),
    }
    fits = nodes > 1 and gases > 1 and all(key in air and air[key].shape == shape for key, shape in shapes.items())
    if not fits or not all(np.isfinite(values).all() for values in air.values()):
        raise TwilightError(f"the compact model {name} is damaged: the arrays air_* do not fit together")


def _ozone(medium: Medium, model: CompactSky, name: str) -> float | None:
    """The ozone column [DU] from the absorption of a medium; None where it does not absorb."""
    w, absorbed = medium.wavelength_nm, medium.optical_depth("absorption")
    others, ozone = (np.interp(w, model.air["gases_wavelength_nm"], of) for of in model.air["gases"].astype(float))
    ozone_factor = 1.0
    if ozone.max() >= LEAST_OZONE_DEPTH:
        ozone_factor = float(ozone @ (absorbed - others) / (ozone @ ozone))
    _check_column("the optical depth of its gases", absorbed, others + ozone_factor * ozone, w, name)
    if ozone.max() < LEAST_OZONE_DEPTH:
        return None
    column, low, high = ozone_factor * model.ozone_reference_du, *model.ozone_column_du[[0, -1]]
    slack = TOLERANCE * model.ozone_reference_du
    if not low - slack <= column <= high + slack:
        raise TwilightError(
            f"the compact model {name} has ozone columns from {low:.3g} to {high:.3g} DU, and "
            f"{medium.name or 'the medium'} has {max(column, 0.0):.3g} DU (climate.gases.ozone)"
        )
    return float(np.clip(column, low, high))


def _check_column(what: str, found: np.ndarray, stored: np.ndarray, wavelength_nm: np.ndarray, name: str) -> None:
    """TwilightError where a column of a medium (W,) is not that of the model's air."""
    wrong = np.abs(found - stored) > TOLERANCE * np.abs(stored) + LEAST_DEPTH
    if wrong.any():
        w = int(np.argmax(np.abs(found - stored) * wrong))
        raise TwilightError(
            f"the compact model {name} is of other air: {what} is {found[w]:.4g} here at {wavelength_nm[w]:g} nm, and "
            f"{stored[w]:.4g} in the model's; take --solver zones, or fit a model of this climate: twilight fit compact"
        )


def _fraction(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.where(whole > 0.0, part / np.where(whole > 0.0, whole, 1.0), 0.0)


def _columns_of_particles(medium: Medium) -> np.ndarray:
    """Columns (P, W) that grow in proportion where two aerosols are mixed: of extinction, of scattering, of extinction
    times altitude, of scattering times each value of the phase function."""
    extinction = medium.aerosol_extinction_per_km
    scattering = extinction * medium.aerosol_single_scattering_albedo
    height = (medium.altitude_km - medium.bottom_km)[:, None]
    cosine = np.cos(np.radians(COMPARED_ANGLES_DEG))
    phases = np.zeros((cosine.size, medium.n_wavelengths))
    for fraction, phase in zip(medium.aerosol_phase_fraction, medium.phase_functions, strict=True):
        phases += vertical_integral(scattering * fraction, medium.altitude_km) * phase(cosine).T
    return np.stack(
        [vertical_integral(a, medium.altitude_km) for a in (extinction, scattering, extinction * height)] + [*phases]
    )


def _particles(columns: np.ndarray) -> np.ndarray:
    """PARTICLES (P, W) from their columns; the altitude from 1 km below the ground, that its ratios mean something."""
    depth, scattered, height, *phases = columns
    return np.stack(
        [depth, _fraction(scattered, depth), 1.0 + _fraction(height, depth), *(_fraction(p, scattered) for p in phases)]
    )


def _air(medium: Medium) -> np.ndarray:
    """AIR of a medium, (2, W)."""
    height = (medium.altitude_km - medium.bottom_km)[:, None]
    scattering, z = medium.air_scattering_per_km, medium.altitude_km
    depth = vertical_integral(scattering, z)
    return np.stack([depth, _fraction(vertical_integral(scattering * height, z), depth)])


def _place(medium: Medium) -> np.ndarray:
    """PLACE of a medium: the altitude [km] above -10 km, and the refractivity in 1e-4, of the middle wavelength."""
    return np.array([10.0 + medium.bottom_km, 1e4 * medium.refractivity[0, medium.n_wavelengths // 2]])
