"""Photographs in every format: their light comes back, and a file that is damaged is one sentence."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from twilight.base.errors import TwilightError
from twilight.io.environment_files import to_rgbe
from twilight.io.stored_image import read_image, read_samples, write_exr
from twilight.studies.camera.exif import read_stated
from twilight.studies.camera.response import srgb_to_linear

OpenImageIO = pytest.importorskip("OpenImageIO")

PANORAMA = Path(__file__).parents[1] / "data" / "photos" / "kiara_1_dawn_256.hdr"
RANDOM = np.random.default_rng(1)
EIGHT = RANDOM.integers(0, 256, (20, 30, 3), dtype=np.uint8)
SIXTEEN = RANDOM.integers(0, 65536, (20, 30, 3), dtype=np.uint16)
FLOATS = RANDOM.lognormal(0, 3, (20, 30, 3)).astype(np.float32)


def write(path, kind):
    if kind == "png8":
        Image.fromarray(EIGHT).save(path)
    elif kind in ("png16", "tiff16", "tifff"):
        values = FLOATS if kind == "tifff" else SIXTEEN
        file = OpenImageIO.ImageOutput.create(str(path))
        file.open(str(path), OpenImageIO.ImageSpec(30, 20, 3, "float" if kind == "tifff" else "uint16"))
        file.write_image(values)
        file.close()
    elif kind == "exr":
        write_exr(path, FLOATS)
    elif kind == "hdr":
        header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 20 +X 30\n"
        rows = b"".join(run_lengths(row) for row in to_rgbe(FLOATS))
        path.write_bytes(header + rows)


def run_lengths(row):
    """A scanline (width, 4) with runs where bytes repeat."""
    parts = [bytes([2, 2, row.shape[0] >> 8, row.shape[0] & 255])]
    for channel in row.T:
        i = 0
        while i < channel.size:
            j = i
            while j < channel.size and channel[j] == channel[i] and j - i < 127:
                j += 1
            parts.append(bytes([128 + j - i, channel[i]]) if j - i > 1 else bytes([1, channel[i]]))
            i = j
    return b"".join(parts)


EXPECTED = {
    "png8": (EIGHT / 255.0, ".png", 8, 1e-6),
    "png16": (SIXTEEN / 65535.0, ".png", 16, 1e-6),
    "tiff16": (SIXTEEN / 65535.0, ".tif", 16, 1e-6),
    "tifff": (FLOATS, ".tiff", None, 1e-6),
    "exr": (FLOATS, ".exr", None, 1e-6),
    "hdr": (FLOATS / 2, ".hdr", None, None),
}


@pytest.mark.parametrize("kind", EXPECTED)
def test_samples_come_back(tmp_path, kind):
    """A picture's values would change with its format."""
    values, suffix, bits, tolerance = EXPECTED[kind]
    path = tmp_path / f"photo{suffix}"
    write(path, kind)
    picture = read_samples(path)
    assert picture.bits == bits and picture.linear == (bits is None)
    allowed = tolerance * np.abs(values) if tolerance else values.max(axis=-1, keepdims=True) / 128 / 2 * 1.01
    assert (np.abs(picture.samples - values) <= allowed + 1e-9).all()
    if bits:
        assert (picture.saturated == (values > 0.98).any(axis=-1)).all()


def test_jpeg_and_grey(tmp_path):
    """A grey JPEG would be refused, or decoded as linear light."""
    ramp = np.repeat(np.linspace(0, 255, 64).astype(np.uint8)[None, :], 40, axis=0)
    Image.fromarray(ramp).save(tmp_path / "grey.jpg", quality=95)
    picture = read_image(tmp_path / "grey.jpg", srgb_to_linear)
    assert picture.grey and picture.linear and picture.samples.shape == (40, 64, 3)
    assert np.abs(picture.samples[..., 1] - srgb_to_linear(ramp / 255)).max() < 0.03


def test_exposure_time_from_exif(tmp_path):
    """A bracket would need its exposure times typed in."""
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x829A] = IFDRational(1, 4)
    Image.fromarray(EIGHT).save(tmp_path / "a.jpg", exif=exif)
    assert read_samples(tmp_path / "a.jpg").exposure_time_s == pytest.approx(0.25)


def test_a_mantissa_stands_for_the_middle_of_its_step():
    """Else every sky of a photograph is 0.2 to 0.4 % too dark."""
    lower = OpenImageIO.ImageBuf(str(PANORAMA)).get_pixels(OpenImageIO.FLOAT)
    mine = read_samples(PANORAMA).samples
    step = np.exp2(np.floor(np.log2(lower.max(axis=-1, keepdims=True))) - 7)
    np.testing.assert_allclose(mine, lower + 0.5 * step, rtol=1e-6)


def test_flat_and_turned_radiance_pictures(tmp_path):
    """Radiance pictures of other programs would be upside down."""
    rgbe = to_rgbe(FLOATS)
    for signs, expected in (("-Y 20 +X 30", FLOATS), ("+Y 20 -X 30", FLOATS[::-1, ::-1])):
        path = tmp_path / "flat.hdr"
        path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{signs}\n".encode() + rgbe.tobytes())
        step = expected.max(axis=-1, keepdims=True) / 128
        assert (np.abs(read_samples(path).samples - expected) <= step).all()


@pytest.mark.parametrize("kind", EXPECTED)
def test_files_cut_off_are_one_sentence(tmp_path, kind):
    """A half-copied picture would be a traceback, or half a sky."""
    suffix = EXPECTED[kind][1]
    whole = tmp_path / f"whole{suffix}"
    write(whole, kind)
    data = whole.read_bytes()
    for fraction in (0.0, 0.02, 0.3, 0.9):
        path = tmp_path / f"cut{suffix}"
        path.write_bytes(data[: int(fraction * len(data))])
        with pytest.raises(TwilightError, match="cut") as refused:
            read_samples(path)
        assert len(str(refused.value).splitlines()) == 1


def test_gigantic_headers_are_refused(tmp_path):
    """Some bytes of header would take all memory."""
    path = tmp_path / "big.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 90000 +X 90000\n" + b"\2\2\0\0" * 100)
    with pytest.raises(TwilightError, match="90000"):
        read_samples(path)
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 100000, 100000, 8, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    path = tmp_path / "big.png"
    path.write_bytes(png + struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT")))
    with pytest.raises(TwilightError, match=r"claims a \d+ MB image from a 45 byte file"):
        read_samples(path)


def test_other_bad_files(tmp_path):
    """A folder, a text or a black picture would be a traceback."""
    (tmp_path / "a.txt").write_text("no picture")
    (tmp_path / "black.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\n" + bytes(64))
    for name, words in (
        ("a.txt", "not known"),
        ("none.png", "no such file"),
        ("", "folder"),
        ("black.hdr", "no light"),
    ):
        with pytest.raises(TwilightError, match=words):
            read_samples(tmp_path / name)
    with pytest.raises(TwilightError, match="linear light"):
        read_image(PANORAMA, srgb_to_linear)


def dng(path, mosaic):
    """A minimal Adobe DNG of a 16 bit Bayer mosaic (H, W), red in the corner, neutral camera white."""
    height, width = mosaic.shape
    formats = {1: "B", 3: "H", 4: "I"}
    byte, text, short, long, rational, srational = 1, 2, 3, 4, 5, 10
    matrix = [3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570]  # XYZ to linear sRGB
    fractions = b"".join(struct.pack("<ii", round(10000 * m), 10000) for m in matrix)
    numbers = {
        254: (long, 0), 256: (long, width), 257: (long, height), 258: (short, 16), 259: (short, 1), 262: (short, 32803),
        274: (short, 1), 277: (short, 1), 278: (long, height), 279: (long, mosaic.size * 2), 284: (short, 1),
        33421: (short, 2, 2), 33422: (byte, 0, 1, 1, 2), 50706: (byte, 1, 4, 0, 0), 50714: (short, 0),
        50717: (long, 65535), 50778: (short, 21),
    }  # fmt: skip
    entries = [
        (tag, kind, len(values), struct.pack(f"<{len(values)}{formats[kind]}", *values))
        for tag, (kind, *values) in numbers.items()
    ]
    entries += [(tag, text, 5, b"Test\0") for tag in (271, 272, 50708)]
    entries += [(273, long, 1, None), (50721, srational, 9, fractions)]
    entries += [(50728, rational, 3, struct.pack("<6I", 1, 1, 1, 1, 1, 1))]
    entries.sort(key=lambda entry: entry[0])
    start = 8 + 2 + 12 * len(entries) + 4
    directory, more = struct.pack("<H", len(entries)), b""
    total = sum(len(value) for *_, value in entries if value is not None and len(value) > 4)
    for tag, kind, count, value in entries:
        value = struct.pack("<I", start + total) if value is None else value
        if len(value) > 4:
            cell = struct.pack("<I", start + len(more))
            more += value
        else:
            cell = value.ljust(4, b"\0")
        directory += struct.pack("<HHI", tag, kind, count) + cell
    data = b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", 0) + more
    path.write_bytes(data + mosaic.astype("<u2").tobytes())


def test_heif_is_eight_bits_with_exif(tmp_path):
    """Pictures of telephones would be refused, or lose their focal length."""
    heif = pytest.importorskip("pillow_heif")
    heif.register_heif_opener()
    grey = np.repeat(np.linspace(20, 230, 64).astype(np.uint8)[None, :, None], 64, axis=0).repeat(3, axis=-1)
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 26
    Image.fromarray(grey).save(tmp_path / "a.heic", quality=95, exif=exif)
    picture = read_image(tmp_path / "a.heic", srgb_to_linear)
    assert picture.bits == 8 and not picture.saturated[:, :60].any()
    assert np.abs(picture.samples - srgb_to_linear(grey / 255.0)).max() < 0.03
    assert read_stated(tmp_path / "a.heic").focal_35mm == 26.0
    (tmp_path / "cut.heic").write_bytes((tmp_path / "a.heic").read_bytes()[:200])
    with pytest.raises(TwilightError, match="cut"):
        read_image(tmp_path / "cut.heic")


def test_raw_is_linear(tmp_path):
    """A raw file would be brightened or clipped by its developer's curve."""
    pytest.importorskip("rawpy")
    levels = np.repeat(np.array([4000, 8000, 16000, 32000]), 32)
    dng(tmp_path / "a.dng", np.tile(levels, (64, 1)))
    picture = read_image(tmp_path / "a.dng")
    assert picture.bits == 16 and not picture.saturated.any()
    middle = picture.samples[16:-16, 16::32][:, :4].mean(axis=0)
    assert np.allclose(middle / middle[0], np.array([1, 2, 4, 8])[:, None], rtol=0.01)
    data = (tmp_path / "a.dng").read_bytes()
    (tmp_path / "cut.dng").write_bytes(data[:300])
    with pytest.raises(TwilightError, match="cut"):
        read_image(tmp_path / "cut.dng")
