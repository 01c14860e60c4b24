"""The section `output:` of a configuration: which files, for which program, and how their pictures look."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, model_validator

from twilight.base.formats import FORMATS, check_names
from twilight.config.base import Flag, Integer, Number, Section, key


def _files(value: tuple[str, ...] | None) -> tuple[str, ...] | None:
    if value == ():
        raise ValueError("must name one file at least")
    return value if value is None else check_names(value)


class EyeTone(Section):
    """Who looks, where the pictures are as an eye sees."""

    adapted_cd_per_m2: Number | None = key(
        None, "luminance that the eye is adapted to; unset: to the picture", unit="cd m-2", ge=1e-6, le=1e5
    )
    acuity: Flag = key(True, "whether fine details are lost at low light")


class CameraTone(Section):
    """The camera, where the pictures are photographs."""

    iso: Number = key(100.0, "sensitivity", unit="1", ge=25.0, le=1e6)
    seconds: Number | None = key(None, "exposure time; unset: by the meter, 1/8000 to 30 s", unit="s", gt=0.0, le=1e5)
    f_number: Number = key(4.0, "focal length over aperture", unit="1", ge=0.5, le=64.0)
    white_balance_k: Number = key(5500.0, "colour temperature of the light that is white", unit="K", ge=1500, le=25000)
    sensor: Literal["nikon_5100", "sigma_sd_merrill"] = key("nikon_5100", "whose spectral response")
    noise: Flag = key(True, "noise of photons and of reading")


class Output(Section):
    """How the pictures look and which program they are for; the radiance in the files does not depend on it."""

    files: Annotated[tuple[str, ...] | None, AfterValidator(_files)] = key(
        None,
        f"which files are written: {', '.join(FORMATS.own)}; unset: all, polarisation where the light is polarised",
    )
    polariser_deg: Number | None = key(
        None,
        "axis of a polariser before the pictures and sky.rgb.exr, from the vertical of each line of sight, clockwise; "
        "unset: none",
        unit="deg",
        ge=-180.0,
        le=180.0,
    )
    renderer: Literal["openexr", "mitsuba", "blender", "radiance", "pbrt"] = key(
        "openexr", "whose environment map sky.rgb.exr is"
    )
    disc: Flag = key(False, "whether the sun's disc is in the environment maps; it needs sun.disc")
    width: Integer = key(1024, "of sky.rgb.exr", unit="pixel", ge=8, le=16384)
    spectral_width: Integer = key(256, "of sky.spectral.exr", unit="pixel", ge=8, le=16384)
    views: tuple[Literal["wide", "panorama", "fisheye"], ...] = key(
        ("wide",),
        "pictures: wide looks to the sun's side over a horizon, panorama goes all round, fisheye looks up; the "
        "first is sky.png, others sky.VIEW.png",
        min_length=1,
        max_length=3,
    )
    exposure_ev100: Number | None = key(
        None,
        "exposure of the pictures (15: sunlit, -3: deep twilight); unset: by the sky",
        unit="EV",
        ge=-60.0,
        le=60.0,
    )
    exposure: Literal["each", "series"] = key(
        "each", "where exposure_ev100 is unset: each picture by its own sky, or all of a series by the brightest"
    )
    tone_mapping: Literal["photographic", "filmic", "gamma", "eye", "camera"] = key(
        "photographic",
        "of the pictures: photographic has contrast, filmic is soft, gamma clips, eye sees as a person does at low "
        "light, camera takes a photograph",
    )
    eye: EyeTone = key(EyeTone, "of tone_mapping eye")
    camera: CameraTone = key(CameraTone, "of tone_mapping camera")
    colour_observer: Literal["cie1964_10deg", "cie1931_2deg"] = key("cie1964_10deg", "standard observer of all colours")

    @model_validator(mode="after")
    def _check(self) -> Output:
        for name in ("width", "spectral_width"):
            if getattr(self, name) % 4:
                raise ValueError(f"{name} must be a multiple of 4; got {getattr(self, name)}")
        return self
