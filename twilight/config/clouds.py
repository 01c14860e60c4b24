"""Clouds of a climate document: layers that cover the whole sky."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from twilight.config.base import Number, Section, key

THINNEST_KM = 0.01
"""Least thickness of a cloud [km]."""

CloudKind = Literal["fog", "stratus", "altostratus", "cirrus", "noctilucent"]


class Cloud(Section):
    """A homogeneous layer of cloud, the same from horizon to horizon; what is unset is the kind's own."""

    kind: CloudKind = key(
        "stratus",
        "fog, stratus, altostratus: droplets; cirrus: hexagonal crystals with halos; noctilucent: grains of ice at "
        "83 km, lit while the sun is at -6 to -16 deg",
    )
    base_km: Number | None = key(
        None,
        "altitude above sea level where it begins; unset: fog the ground, stratus 0.5, altostratus 3, cirrus 9, "
        "noctilucent 82.4",
        unit="km",
        ge=0.0,
        le=119.0,
    )
    top_km: Number | None = key(
        None,
        "altitude where it ends; unset: above the base fog 0.2, stratus 0.5, altostratus 1, cirrus 1.5, noctilucent 1",
        unit="km",
        ge=0.0,
        le=120.0,
    )
    optical_depth: Number | None = key(
        None,
        "vertical, at 550 nm; unset: fog 5, stratus 25, altostratus 10, cirrus 1, noctilucent 1e-5",
        unit="1",
        ge=0.0,
        le=100.0,
    )
    effective_radius_um: Number | None = key(
        None,
        "of the spheres' sizes, of cirrus none; unset: fog 10.7, stratus and altostratus 7.33, noctilucent 0.05",
        unit="um",
        ge=0.01,
        le=50.0,
    )

    @model_validator(mode="after")
    def _possible(self) -> Cloud:
        base, top = self.base_km, self.top_km
        if base is not None and top is not None and top < base + THINNEST_KM * (1.0 - 1e-9):
            raise ValueError(f"top_km, {top:g}, must be {THINNEST_KM:g} km or more above base_km, {base:g}")
        if self.kind == "cirrus" and self.effective_radius_um is not None:
            raise ValueError("effective_radius_um has no meaning for cirrus, whose crystals are OPAC's (91.7 um)")
        return self
