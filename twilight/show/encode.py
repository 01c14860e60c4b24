"""Pictures of a film to one file, MP4, WebP or GIF, or to a folder of numbered EXR: whole or not at all."""

import itertools
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.progress import Progress
from twilight.base.whole_files import link_or_copy, whole_file, whole_folder
from twilight.io.exr import write_channels
from twilight.numerics import spectrum
from twilight.sky import colour

SUFFIXES = (".mp4", ".webp", ".gif", "")
"""Of films; without one, a folder of EXR."""
MP4_QUALITY = 16
"""Constant rate factor of H.264: noise of one step, the dither, mostly remains."""
MP4_COLOURS = ("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv")
"""Options of ffmpeg that name the pictures' colours: Rec. 709 with the curve of sRGB, in the range of video."""
WEBP_EFFORT = 60
"""0 to 100, how hard the lossless coder of WebP tries; pictures are kept as they are.  Lossy WebP, even at its best,
smooths away the dither and leaves blocks of one grey in dark skies."""


def check_output(output: Path, shape: tuple[int, int], frames_per_second: float) -> None:
    """Raise TwilightError, before anything is computed, for a file that cannot be made of pictures (height, width)."""
    suffix, (height, width) = output.suffix.lower(), shape
    if suffix not in SUFFIXES:
        raise TwilightError(
            f"--output: {output} must end in .mp4, .webp or .gif, or in no suffix for a folder of numbered EXR"
        )
    if not suffix and output.exists():
        raise TwilightError(f"--output: {output} exists; a film in EXR makes a new folder")
    if suffix == ".mp4":
        if not is_installed("imageio_ffmpeg"):
            raise missing("imageio_ffmpeg", "writing MP4")
        if height % 2 or width % 2:
            raise TwilightError(f"--width, --height: MP4 needs even numbers of pixels; got {width} x {height}")
    if suffix == ".gif" and frames_per_second > 50.0:
        raise TwilightError(f"--frames-per-second: a GIF has 50 at most; got {frames_per_second:g}")


def encode(pictures: Sequence[Path], output: Path, frames_per_second: float, progress: Progress) -> None:
    """Make the film of pictures that are on disk: PNG of one size, or EXR.  Errors: TwilightError."""
    if not output.suffix:
        _folder(pictures, output)
        return
    with whole_file(output) as temporary:
        if output.suffix.lower() == ".mp4":
            _mp4(pictures, temporary, frames_per_second, progress)
        else:
            _animated(pictures, temporary, frames_per_second, progress)


def _reporting(pictures: Sequence[Path], progress: Progress) -> Iterator[Any]:
    from PIL import Image  # start-up

    for i, path in enumerate(pictures):
        with Image.open(path) as image:
            yield image.convert("RGB")
        progress(f"encoding {i + 1} of {len(pictures)}", (i + 1) / len(pictures))


def _mp4(pictures: Sequence[Path], path: Path, frames_per_second: float, progress: Progress) -> None:
    """Pipe the pictures through ffmpeg, whose exit code alone says whether the disk held the end of the film."""
    import imageio_ffmpeg  # optional

    images = _reporting(pictures, progress)
    first = next(images)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", "{}x{}".format(*first.size), "-r", f"{frames_per_second:.2f}", "-i", "-", "-an"]
    command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", str(MP4_QUALITY)]
    command += ["-vf", "scale=out_color_matrix=bt709:out_range=tv", *MP4_COLOURS, "-movflags", "+faststart"]
    with subprocess.Popen([*command, str(path)], stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            with suppress(BrokenPipeError):  # ffmpeg has left, and says why
                for image in itertools.chain([first], images):
                    process.stdin.write(np.asarray(image).tobytes())  # type: ignore[union-attr]
            said = process.communicate()[1].decode(errors="replace").strip()
        except BaseException:
            process.kill()
            raise
    if process.returncode or not path.is_file():
        raise OSError(said or f"ffmpeg left with {process.returncode}")


def _animated(pictures: Sequence[Path], path: Path, frames_per_second: float, progress: Progress) -> None:
    """GIF counts hundredths of a second, WebP thousandths: times are rounded so that the film keeps its length."""
    unit = 10 if path.suffix.lower() == ".gif" else 1
    ends = np.round(np.arange(len(pictures) + 1) * 1000.0 / frames_per_second / unit).astype(int) * unit
    images = _reporting(pictures, progress)
    options: dict[str, Any] = {"lossless": True, "quality": WEBP_EFFORT, "method": 2}
    if unit == 10:
        images, options = (_indexed(image) for image in images), {"disposal": 1, "optimize": False}
    next(images).save(path, save_all=True, append_images=images, duration=np.diff(ends).tolist(), loop=0, **options)


def _indexed(image: Any) -> Any:
    """The picture in 256 colours of its own, with the error carried on, so that it shows no bands."""
    from PIL import Image  # start-up

    return image.quantize(palette=image.quantize(256), dither=Image.Dither.FLOYDSTEINBERG)


def _folder(pictures: Sequence[Path], output: Path) -> None:
    """The pictures as 00001.exr and so on; they are linked or copied, so that none is lost on the way."""
    with whole_folder(output) as made:
        for i, picture in enumerate(pictures):
            link_or_copy(picture, made / f"{i + 1:05d}.exr")


def write_exr(light: np.ndarray, inside: np.ndarray, path: Path, facts: dict[str, Any]) -> None:
    """Write a picture (H, W, 3 or more) of X, Y, Z [cd m^-2] as linear Rec. 709 in units of 683 cd m^-2, float32, with
    alpha 1 where `inside` (H, W).  facts: attributes of the file's header."""
    rgb = colour.xyz_to_linear_rgb(light[..., :3]) / spectrum.LUMINOUS_EFFICACY_LM_PER_W
    channels = {name: rgb[..., i] for i, name in enumerate("RGB")} | {"A": inside}
    write_channels(path, channels, {"whiteLuminance": float(spectrum.LUMINOUS_EFFICACY_LM_PER_W), **facts})
