"""What may be asked of an estimate, once: the arguments of `twilight.estimate`, the options of the commands that take
photographs, and how a picture is read."""

# `asked` makes fields
# ruff: noqa: RUF009
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent

if TYPE_CHECKING:
    from twilight.studies.camera import CameraModel

TYPES = ("continental_average", "maritime_clean", "desert", "urban")
"""Aerosol types that are tried."""
PARAMETERS = ("ozone", "albedo")
"""What is estimated beside the aerosol's optical depth."""


def asked(default: Any, says: str, metavar: str = "") -> Any:
    """A field: its default, what it means, and what the commands' help calls its value; without one they have no such
    option."""
    return field(default=default, metadata={"says": says, "metavar": metavar})


@dataclass(frozen=True)
class EstimateOptions:
    """All that may be said beside the picture; each field says what it means.

    Errors: TwilightError for whatever is not allowed.
    """

    scene: Any = asked(
        "continental-average",
        "As of `render`: all that is not estimated.  Its sun counts where it is given: an elevation, a place and time, "
        "or several elevations to search between; otherwise that of the file's time and place, or all are searched.  "
        "Its horizon counts where it is given (`clean`: nothing beyond it); otherwise it is `typical`.  So does its "
        "`observer.altitude_km`; otherwise that of the file, or the haze's interval holds what may lie below the "
        "camera.",
    )
    _: KW_ONLY
    camera: str | Path | CameraModel | None = asked(
        None,
        "Projection, lens, orientation, response; unset: a panorama (2:1), or what the file says.  An angle above the "
        "horizontal that neither says is found by the horizon, or with the air.",
        "CAMERA.yaml",
    )
    field_of_view_deg: float | None = asked(
        None, "Across the width of a picture whose file does not say the focal length in 35 mm.", "DEG"
    )
    sun_elevation_deg: float | Sequence[float] | None = asked(
        None,
        "True elevation of the sun, of every picture; unset: the scene's, Exif's, its disc's, searched.",
        "DEG,...",
    )
    sun_azimuth_deg: float | None = asked(
        None, "In the camera's azimuths; unset: the scene's if the camera's azimuth is known, else found.", "DEG"
    )
    types: Sequence[str] = asked(TYPES, "Aerosol types to try.", "NAMES")
    parameters: Sequence[str] = asked(PARAMETERS, "Estimated besides the aerosol's optical depth, or none.", "NAMES")
    white_balance: bool | None = asked(
        None, "Free gains of red, green and blue besides the exposure; unset: unless a camera is given.", "yes"
    )
    tone_curve: bool | None = asked(None, "A free curve of three numbers; unset: of sRGB pictures.", "yes")
    colour: bool = asked(True, "Compare differences of colour over the sky, not of brightness alone.", "yes")
    mask: str | Path | None = asked(None, "Picture of the photograph's size, bright where there is sky.", "IMAGE")
    automatic_mask: bool = asked(True, "Look for ground, trees, buildings and clouds.", "yes")
    min_elevation_deg: float = asked(3.0, "Compare nothing below.", "DEG")
    glare_deg: float = asked(10.0, "Radius about a risen sun that is masked.", "DEG")
    resolution_deg: float = asked(3.0, "Cells of the comparison; must divide 90.", "DEG")
    settings: Mapping[str, object] | None = asked(None, "Dotted keys of the scene.")
    name: str | Sequence[str] | None = asked(
        None, "Of the picture, in sentences and in the climate; unset: of its file."
    )
    progress: Progress = asked(silent, "Called as progress(doing, fraction) now and then.")

    def __post_init__(self) -> None:
        from twilight.base.sections import unknown  # start-up
        from twilight.config.aerosol import AerosolType  # start-up

        given = (("types", self.types, get_args(AerosolType)), ("parameters", self.parameters, PARAMETERS))
        for what, names, allowed in given:
            for word in names:
                if word not in allowed:
                    raise TwilightError(f"{what}: {word} {unknown(word, sorted(allowed), what[:-1])}")
        if not self.types:
            raise TwilightError("types: names no aerosol type")

    @property
    def suns_deg(self) -> list[float] | None:
        """The sun's elevation of every picture."""
        if self.sun_elevation_deg is None:
            return None
        import numpy as np  # start-up

        return [float(sun) for sun in np.atleast_1d(np.asarray(self.sun_elevation_deg, float))]


TO_THE_HORIZON: dict[str, Any] = {"min_elevation_deg": 0.0, "glare_deg": 6.0, "resolution_deg": 2.0}
"""How pictures are read that are shown beside a sky and not fitted: down to the horizon, in smaller cells."""
