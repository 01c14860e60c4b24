"""Figures that characterise a medium: optical depths by part, scale heights, horizontal refraction."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.aerosols import VISIBLE_CONTRAST_DEPTH
from twilight.atmosphere.medium import Medium
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray


def optical_depths(medium: Medium) -> list[tuple[str, np.ndarray]]:
    """Vertical optical depth (W,) of each part the medium was made of, and of all that is in the air together."""
    parts = medium.notes.get("optical_depth")
    if parts is None:
        names = {"air": "air", "gases": "absorption", "aerosol": "aerosol"}
        rows = [(name, medium.optical_depth(part)) for name, part in names.items()]
    else:
        rows = [(name, np.asarray(depth)) for name, depth in parts.items()]
        rows.append(("all particles", medium.optical_depth("aerosol")))
    return [*rows, ("total", medium.optical_depth("total"))]


def scale_height_km(medium: Medium, part: str) -> float:
    """Optical depth over the coefficient at the ground [km] at the middle wavelength; nan where there is none.

    part: `air` or `aerosol`.  An exponential atmosphere gives its scale height, a homogeneous layer its thickness.
    """
    middle = medium.n_wavelengths // 2
    coefficient = {"air": medium.air_scattering_per_km, "aerosol": medium.aerosol_extinction_per_km}[part][0, middle]
    return float(medium.optical_depth(part)[middle] / coefficient) if coefficient > 0 else float("nan")


def horizontal_refraction_arcmin(medium: Medium) -> np.ndarray:
    """Bending [arcmin], (W,), of a ray that reaches an observer on the ground horizontally; nan where it is trapped."""
    profile = ray_profile(medium)
    bending = np.full(medium.n_wavelengths, np.nan)
    for w in range(medium.n_wavelengths):
        value, _, status = sun_ray(profile, w, medium.bottom_km, 0.0, 0.0)
        if status == OUTSIDE:
            bending[w] = np.degrees(value) * 60.0
    return bending


def facts(medium: Medium) -> list[tuple[str, str]]:
    """What `twilight show NAME` says below the optical depths: names and values with their units."""
    rows = [("ground", f"{medium.bottom_km:g} km above sea level")] if medium.bottom_km != 0.0 else []
    rows += [("top of the air", f"{medium.top_km:g} km"), ("levels", str(np.unique(medium.altitude_km).size))]
    for part in ("air", "aerosol"):
        height = scale_height_km(medium, part)
        if np.isfinite(height):
            rows.append((f"scale height of the {part}", f"{height:.2f} km"))
    if "ozone_column_du" in medium.notes:
        column, source = medium.notes["ozone_column_du"], medium.notes["ozone_source"]
        rows.append(("ozone column", f"{column:.0f} DU ({source})" if column > 0.0 else "0 DU"))
    if "water_vapour_column_mm" in medium.notes:
        column, source = medium.notes["water_vapour_column_mm"], medium.notes["water_vapour_source"]
        rows.append(("water vapour column", f"{column:.1f} mm ({source})" if column > 0.0 else "0 mm"))
    at_550 = np.flatnonzero(medium.wavelength_nm == 550.0)
    if at_550.size and medium.has_aerosol:
        w = at_550[0]
        turbidity = 1.0 + medium.optical_depth("aerosol")[w] / max(medium.optical_depth("air")[w], 1e-300)
        seen_through = medium.air_scattering_per_km[0, w] + medium.aerosol_extinction_per_km[0, w]
        visibility = VISIBLE_CONTRAST_DEPTH / max(seen_through, 1e-300)
        rows.append(("turbidity at 550 nm (Preetham 1999)", f"{turbidity:.2f}"))
        rows.append(("visibility at the ground at 550 nm (Koschmieder)", f"{visibility:.0f} km"))
    for name, bottom, top in medium.notes.get("regions", ()):
        rows.append((f"particles: {name}", f"{bottom:g} to {top:g} km"))
    middle = medium.n_wavelengths // 2
    if medium.has_refraction:
        bending = horizontal_refraction_arcmin(medium)[middle]
        at = f"at {medium.wavelength_nm[middle]:g} nm"
        rows.append((f"refractive index at the ground, {at}", f"1 + {medium.refractivity[0, middle]:.4e}"))
        rows.append((f"horizontal refraction at the ground, {at}", f"{bending:.1f} arcmin"))
    else:
        rows.append(("refraction", "none"))
    albedo = medium.ground_albedo
    rows.append(
        ("albedo of the ground", " to ".join(f"{a:g}" for a in sorted({float(albedo.min()), float(albedo.max())})))
    )
    return rows
