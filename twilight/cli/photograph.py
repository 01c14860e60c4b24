"""The photograph of `twilight validate photo` and `estimate`: its options, and how they become one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from twilight.cli import options
from twilight.cli.options import argument, flag, option

Image = Annotated[Path, argument("IMAGE", "HDR, EXR, TIFF, PNG, JPEG or RAW.")]
CameraFile = Annotated[
    Path | None,
    option("CAMERA.yaml", "Projection, lens, orientation, response; unset: a panorama (2:1), or what the file says."),
]
FieldOfView = Annotated[
    float | None, option("DEG", "Across the width of a picture whose file does not say the focal length in 35 mm.")
]
WhiteBalance = Annotated[bool, flag("--white-balance", "Free gains of red, green and blue besides the exposure.")]
Azimuth = Annotated[
    float | None,
    option("DEG", "In the camera's azimuths; unset: the scene's if the camera's azimuth is known, else found."),
]
Skyline = Annotated[
    Path | None, option("FILE.csv", "Skyline: azimuth_deg,elevation_deg; below it is no sky.", "--profile")
]
MaskImage = Annotated[
    Path | None, option("IMAGE", "Picture of the photograph's size, bright where there is sky.", "--mask")
]
NoAutomaticMask = Annotated[bool, flag("--no-automatic-mask", "Do not look for ground, trees, buildings and clouds.")]
MinElevation = Annotated[float, option("DEG", "Compare nothing below.")]
Glare = Annotated[float, option("DEG", "Radius about a risen sun that is masked.")]
Resolution = Annotated[float, option("DEG", "Cells of the comparison; must divide 90.")]
Settings = Annotated[list[str] | None, option("KEY=VALUE", "Any key of the scene; may be repeated.", "--set")]
Folder = Annotated[Path | None, option("DIR", "Folder for the files; made where it is missing.")]


def open_photograph(
    image: Path,
    camera: Path | None,
    sun_azimuth_deg: float | None,
    *,
    profile: Path | None,
    mask: Path | None,
    automatic: bool,
    min_elevation_deg: float,
    glare_deg: float,
    resolution_deg: float,
    field_of_view_deg: float | None = None,
) -> Any:
    """The `Photograph` of these options; errors: TwilightError for an option out of range and files that are wrong."""
    from twilight.studies.camera import read_camera
    from twilight.studies.validate.photographs.photograph import read_photograph

    options.check_range(sun_azimuth_deg, "--sun-azimuth", -360.0, 360.0)
    photograph = read_photograph(
        image,
        None if camera is None else read_camera(camera),
        cell_deg=resolution_deg,
        profile=profile,
        mask_image=mask,
        automatic=automatic,
        min_elevation_deg=min_elevation_deg,
        glare_deg=glare_deg,
        field_of_view_deg=field_of_view_deg,
    )
    taken = photograph.camera
    if camera is None and taken.projection == "latlong":
        print(
            f"twilight: no --camera: {image.name} is taken for a panorama of the whole sphere, "
            f"{taken.image.width_px} x {taken.image.height_px}, north unknown, {taken.response}",
            file=sys.stderr,
        )
    return photograph
