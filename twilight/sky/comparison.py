"""`SkyComparison`: how one sky differs from another in every direction; what `sky - other` and `sky / other` give."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Literal, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIGNS = {"difference": "-", "ratio": "/"}
"""Kinds of comparison, and how Python writes them."""


class Comparable(Protocol):
    """What a comparison asks of a `Sky`."""

    @property
    def wavelength_nm(self) -> np.ndarray: ...
    @property
    def elevation_deg(self) -> np.ndarray: ...
    @property
    def azimuth_deg(self) -> np.ndarray: ...
    @property
    def sun_elevation_deg(self) -> float: ...
    @property
    def radiance(self) -> np.ndarray: ...
    def luminance(self) -> np.ndarray: ...
    def resample(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Self: ...


S = TypeVar("S", bound=Comparable)


@dataclass(frozen=True, eq=False)
class SkyComparison(Generic[S]):
    """Difference `first - second` or ratio `first / second` of two skies with the same wavelengths.

    Both are of the radiance, sun and night together: skies under different suns, airs or observers may be compared, in
    the directions of the first, at which the second is read (`Sky.resample`).

    Errors: TwilightError for skies with other wavelengths, and a second that does not reach as low as the first.
    """

    first: S
    second: S
    kind: Literal["difference", "ratio"]

    def __post_init__(self):
        sign = f"sky {SIGNS[self.kind]} other"
        a, b = self.first, self.second
        if not np.array_equal(a.wavelength_nm, b.wavelength_nm):
            both = " and ".join(f"{w.size} from {w[0]:g} to {w[-1]:g} nm" for w in (a.wavelength_nm, b.wavelength_nm))
            raise TwilightError(f"{sign}: the skies have different wavelengths ({both}); compute both with the same")
        same = a.elevation_deg.size == b.elevation_deg.size and a.azimuth_deg.size == b.azimuth_deg.size
        if not (same and np.allclose(a.elevation_deg, b.elevation_deg) and np.allclose(a.azimuth_deg, b.azimuth_deg)):
            object.__setattr__(self, "second", b.resample(a.elevation_deg, a.azimuth_deg))

    def of(self, first: ArrayLike, second: ArrayLike) -> np.ndarray:
        """Numbers of both skies compared as this does; a ratio is NaN where `second` is 0."""
        own, other = np.asarray(first, float), np.asarray(second, float)
        if self.kind == "difference":
            return own - other
        return np.divide(own, other, out=np.full(np.broadcast_shapes(own.shape, other.shape), np.nan), where=other > 0)

    @property
    def radiance(self) -> np.ndarray:
        """Difference of the radiance [W m^-2 sr^-1 nm^-1], or its ratio, (E, A, W)."""
        return self.of(self.first.radiance, self.second.radiance)

    def luminance(self) -> np.ndarray:
        """Difference of the luminance [cd m^-2], or its ratio, (E, A)."""
        return self.of(self.first.luminance(), self.second.luminance())

    def __repr__(self) -> str:
        """Two lines: which skies, and how far apart they are."""
        ratios = self.luminance()
        ratios = ratios[np.isfinite(ratios)]
        unit = " cd m^-2" if self.kind == "difference" else ""
        low, middle, high = np.quantile(ratios, (0.0, 0.5, 1.0)) if ratios.size else (np.nan,) * 3
        return (
            f"<SkyComparison: {self.kind} of skies, suns at {self.first.sun_elevation_deg:+.2f} and "
            f"{self.second.sun_elevation_deg:+.2f} deg\n"
            f"  luminance {low:.4g} to {high:.4g}{unit}, median {middle:.4g}>"
        )

    if TYPE_CHECKING:  # what draws stands above this room: `twilight.api.representation` attaches these

        def plot(
            self,
            projection: str = "fisheye",
            ax: Axes | None = None,
            wavelength_nm: float | None = None,
            width: int | None = None,
        ) -> Figure: ...
        def to_xarray(self) -> xarray.Dataset: ...
