"""Twilight flats: electrons of a pixel from the sky's photons, exposures for wanted counts and counts of exposures.

    electrons s^-1 = eta A omega integral L(lambda) S(lambda) lambda / (h c) dlambda

A the collecting area, omega the pixel's solid angle, S the band's response to photons over its largest value, eta the
throughput where S is 1.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.quantities.measure import ARCSEC2_SR


@dataclass(frozen=True)
class Flats:
    """A telescope with its camera, and what is wanted of a flat.

    band: of `twilight.sky.quantities.responses`; aperture_m, obstruction_m: diameters; pixel_arcsec: side; throughput:
    of filter, optics and detector at the band's maximum; gain: electrons of a count; level_counts: that
    a flat is to have; saturation_counts: that a pixel never exceeds; exposure_s: of flats of one length, None where it
    is asked for.  Counts are of light: a camera adds its bias.
    """

    EXPOSURE: ClassVar[str] = "flat_exposure"
    COUNTS: ClassVar[str] = "flat_counts"

    band: str = "V"
    aperture_m: float = 1.0
    obstruction_m: float = 0.0
    pixel_arcsec: float = 0.5
    throughput: float = 0.5
    gain: float = 1.0
    level_counts: float = 30_000.0
    saturation_counts: float = 65_535.0
    exposure_s: float | None = None

    def __post_init__(self) -> None:
        positive = ("aperture_m", "pixel_arcsec", "throughput", "gain", "level_counts", "saturation_counts")
        for name in (*positive, *(("exposure_s",) if self.exposure_s is not None else ())):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise TwilightError(f"--{name.replace('_', '-')}: must be above 0, not {getattr(self, name):g}")
        if not 0.0 <= self.obstruction_m < self.aperture_m:
            raise TwilightError("--obstruction-m: must be from 0 to less than the aperture")
        if self.throughput > 1.0:
            raise TwilightError("--throughput: must be at most 1")
        if self.level_counts >= self.saturation_counts:
            raise TwilightError(
                f"--level-counts: {self.level_counts:g} is not below the saturation, {self.saturation_counts:g}"
            )

    @property
    def changed(self) -> str:
        """The first part that is not the usual one; empty where all are."""
        return next((one.name for one in fields(self) if getattr(self, one.name) != one.default), "")

    @property
    def column(self) -> str:
        """The column that is asked for: of exposures, or of counts where the exposure is given."""
        return f"{self.EXPOSURE if self.exposure_s is None else self.COUNTS}@zenith"

    @property
    def conditions(self) -> tuple[str, ...]:
        """With a given exposure: from when on a pixel is not saturated, and has no more than the counts wanted."""
        if self.exposure_s is None:
            return ()
        return tuple(f"{self.column} < {limit:g}" for limit in (self.saturation_counts, self.level_counts))

    def about(self, exposures: bool) -> str:
        """What a column is."""
        if exposures:
            return f"exposure of a twilight flat of {self.level_counts:g} counts in {self.band}"
        return f"counts of a pixel in {self.exposure_s or 1.0:g} s in {self.band}, at most {self.saturation_counts:g}"

    def electrons_per_s(self, photon_radiance: np.ndarray) -> np.ndarray:
        """Of a pixel, from photon radiance within the band [s^-1 m^-2 sr^-1]."""
        area = 0.25 * np.pi * (self.aperture_m**2 - self.obstruction_m**2)
        return photon_radiance * area * self.pixel_arcsec**2 * ARCSEC2_SR * self.throughput

    def exposures_s(self, photon_radiance: np.ndarray) -> np.ndarray:
        """Until a pixel has level_counts."""
        with np.errstate(divide="ignore"):
            return self.level_counts * self.gain / self.electrons_per_s(photon_radiance)

    def counts(self, photon_radiance: np.ndarray) -> np.ndarray:
        """Of a pixel in exposure_s, or in 1 s; held at saturation_counts."""
        made = self.electrons_per_s(photon_radiance) * (self.exposure_s or 1.0) / self.gain
        return np.minimum(made, self.saturation_counts)
