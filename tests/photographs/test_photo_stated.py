"""What a picture's file states of its colours and of where its pixels belong is used, or refused, never ignored."""

import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo

from twilight.base.errors import TwilightError
from twilight.io.environment_files import to_rgbe
from twilight.io.stored_image import read_image, read_samples, srgb_to_linear, write_exr
from twilight.numerics.spectrum import to_rec709, xyz_to_rgb_matrix

OpenImageIO = pytest.importorskip("OpenImageIO")

AS_MET = Path("../shared/data/files_as_met")
REC2020 = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)
P3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
RANDOM = np.random.default_rng(3)
LIGHT = RANDOM.lognormal(0, 1, (20, 40, 3)).astype(np.float32)
EIGHT = RANDOM.integers(30, 220, (20, 40, 3), dtype=np.uint8)
D65_TO_D50 = np.array(
    [[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491], [-0.0092345, 0.0150436, 0.7521316]]
)


def from_709(chromaticities):
    matrix = to_rec709(chromaticities)
    return np.eye(3) if matrix is None else np.linalg.inv(matrix)


def linear_to_srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def test_matrices_of_primaries():
    """Rec. 709 needs none, XYZ is that of the observer, and white stays white where the whites are the same."""
    assert to_rec709((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)) is None
    np.testing.assert_allclose(to_rec709(XYZ), xyz_to_rgb_matrix("cie1931_2deg"), atol=1e-6)
    np.testing.assert_allclose(to_rec709(REC2020) @ np.ones(3), 1.0, atol=1e-3)
    np.testing.assert_allclose(to_rec709(REC2020)[0], [1.6605, -0.5876, -0.0728], atol=1e-3)  # ITU-R BT.2087
    for bad in ((0.3,) * 8, (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3, 0.0)):
        with pytest.raises(ValueError):
            to_rec709(bad)


@pytest.mark.parametrize("primaries", [REC2020, P3, XYZ])
def test_exr_primaries(tmp_path, primaries):
    """An EXR in Rec. 2020, P3 or XYZ would be read as Rec. 709, with pale colours."""
    write_exr(tmp_path / "a.exr", LIGHT @ from_709(primaries).T, {"chromaticities": primaries})
    np.testing.assert_allclose(read_image(tmp_path / "a.exr").samples, LIGHT, rtol=1e-3, atol=1e-4)


def write_windows(path, rgb, data, display, alpha=None):
    channels = {name: np.ascontiguousarray(rgb[..., i]) for i, name in enumerate("RGB")}
    if alpha is not None:
        channels["A"] = alpha
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage,
              "dataWindow": data, "displayWindow": display}  # fmt: skip
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def corners(left, top, width, height):
    return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)


def test_exr_windows(tmp_path):
    """A piece lies where it belongs, what is beyond the display window goes, the rest is not taken for sky."""
    path = tmp_path / "a.exr"
    write_windows(path, LIGHT, corners(10, 5, 40, 20), corners(0, 0, 100, 50))
    found = read_samples(path)
    assert found.samples.shape == (50, 100, 3)
    np.testing.assert_array_equal(found.samples[5:25, 10:50], LIGHT)
    assert not found.saturated[5:25, 10:50].any() and found.saturated.sum() == 5000 - 800
    write_windows(path, LIGHT, corners(-3, -2, 40, 20), corners(0, 0, 37, 18))
    np.testing.assert_array_equal(read_samples(path).samples, LIGHT[2:, 3:])
    write_windows(path, LIGHT, corners(200, 0, 40, 20), corners(0, 0, 100, 50))
    with pytest.raises(TwilightError, match="no pixel within its display window"):
        read_samples(path)


def test_transparent_pixels_show_nothing(tmp_path):
    """What a user has erased would count as black sky."""
    alpha = np.ones((20, 40), np.float32)
    alpha[:8] = 0.0
    write_windows(tmp_path / "a.exr", LIGHT, corners(0, 0, 40, 20), corners(0, 0, 40, 20), alpha)
    assert read_samples(tmp_path / "a.exr").saturated.sum() == 8 * 40
    Image.fromarray(np.dstack([EIGHT, (255 * alpha).astype(np.uint8)])).save(tmp_path / "a.png")
    assert read_samples(tmp_path / "a.png").saturated.sum() == 8 * 40


def test_a_cube_is_no_panorama(tmp_path):
    """Six faces of a cube would be read as one sphere."""
    write_exr(tmp_path / "a.exr", LIGHT, {"envmap": OpenEXR.ENVMAP_CUBE})
    with pytest.raises(TwilightError, match="six sides of a cube"):
        read_samples(tmp_path / "a.exr")


def write_hdr(path, numbers, *lines, kind="rgbe"):
    head = "\n".join(["#?RADIANCE", f"FORMAT=32-bit_rle_{kind}", *lines])
    path.write_bytes(f"{head}\n\n-Y 20 +X 40\n".encode() + to_rgbe(numbers.astype(np.float32)).tobytes())


def test_radiance_heads(tmp_path):
    """Every EXPOSURE and COLORCORR counts; PRIMARIES and XYZ are other colours."""
    path = tmp_path / "a.hdr"
    step = LIGHT.max(axis=-1, keepdims=True) / 60
    write_hdr(path, LIGHT, "EXPOSURE=2", "EXPOSURE= 3", "COLORCORR=1 2 4")
    assert (np.abs(read_samples(path).samples * 6 * np.array([1, 2, 4]) - LIGHT) <= step).all()
    write_hdr(path, LIGHT @ from_709(REC2020).T, "PRIMARIES=" + " ".join(map(str, REC2020)))
    assert (np.abs(read_samples(path).samples - LIGHT) <= step).all()
    write_hdr(path, LIGHT @ from_709(XYZ).T, kind="xyze")
    assert (np.abs(read_samples(path).samples - LIGHT) <= 2 * step).all()
    for line in ("EXPOSURE=much", "EXPOSURE=0", "PRIMARIES=1 2 3", "PRIMARIES=" + "0.3 " * 8):
        write_hdr(path, LIGHT, line)
        with pytest.raises(TwilightError, match=line.partition("=")[0] + "|primaries"):
            read_samples(path)


# ICC profiles, made here: three primaries and one curve


def profile(primaries, curve, space=b"RGB ", names=("rXYZ", "gXYZ", "bXYZ")):
    """An ICC profile of version 2 (curve: the bytes of a tag)."""
    to_xyz = np.linalg.inv(xyz_to_rgb_matrix("cie1931_2deg")) @ np.linalg.inv(from_709(primaries))
    fixed = [b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(65536 * v) for v in c)) for c in (D65_TO_D50 @ to_xyz).T]
    white = b"XYZ \0\0\0\0" + struct.pack(">3i", 63190, 65536, 54061)
    text = b"desc\0\0\0\0\0\0\0\5test\0" + bytes(78 + 3)
    tags = [("desc", text), ("wtpt", white), *zip(names, fixed, strict=True)]
    tags += [(f"{c}TRC", curve) for c in "rgb"]
    head = struct.pack(">I4sI4s4s4s", 0, b"none", 0x02100000, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + struct.pack(">3i", 63190, 65536, 54061)
    head = head.ljust(128, b"\0")
    table, body = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for name, content in tags:
        content = content.ljust(-(-len(content) // 4) * 4, b"\0")
        table += name.encode() + struct.pack(">II", start + len(body), len(content))
        body += content
    data = head + struct.pack(">I", len(tags)) + table + body
    return struct.pack(">I", len(data)) + data[4:]


GAMMA_2 = b"curv\0\0\0\0" + struct.pack(">IH", 1, 512)
TABLE_2 = b"curv\0\0\0\0" + struct.pack(">I256H", 256, *(round(65535 * (i / 255) ** 2) for i in range(256)))
PARA_SRGB = b"para\0\0\0\0\0\3\0\0" + struct.pack(
    ">5i", *(round(65536 * v) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
)
PARA_LAB = b"para\0\0\0\0\0\2\0\0" + struct.pack(">4i", *(round(65536 * v) for v in (2.0, 0.9, 0.0, 0.1)))


@pytest.mark.parametrize(
    ("curve", "light"),
    [
        (GAMMA_2, lambda z: z**2),
        (TABLE_2, lambda z: z**2),
        (PARA_SRGB, srgb_to_linear),
        (PARA_LAB, lambda z: (0.9 * z) ** 2 + 0.1),
    ],
)
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_icc_profiles(tmp_path, curve, light, suffix):
    """Primaries always; the curve in place of sRGB's, but not of one that the camera's file says."""
    path = tmp_path / f"a{suffix}"
    grey = np.repeat(EIGHT[..., :1], 3, axis=-1)
    pixels = np.tile(grey[:1, :8].repeat(8, axis=1), (20, 1, 1)) if suffix == ".jpg" else EIGHT
    options = {"quality": 100, "subsampling": 0} if suffix == ".jpg" else {}
    Image.fromarray(pixels).save(path, icc_profile=profile(P3, curve), **options)
    z = pixels / 255.0
    tolerance = 0.02 if suffix == ".jpg" else 2e-3
    found = read_image(path, srgb_to_linear).samples
    np.testing.assert_allclose(found, light(z) @ to_rec709(P3).T, atol=tolerance)
    np.testing.assert_allclose(read_image(path, lambda z: z**3).samples, z**3 @ to_rec709(P3).T, atol=tolerance)


def test_pillows_own_srgb_profile_changes_nothing(tmp_path):
    """An ordinary sRGB picture would shift in colour because it says so."""
    data = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(EIGHT).save(tmp_path / "a.png", icc_profile=data)
    np.testing.assert_allclose(
        read_image(tmp_path / "a.png", srgb_to_linear).samples, srgb_to_linear(EIGHT / 255.0), atol=5e-4
    )


def test_profiles_that_are_refused(tmp_path):
    """A broken colour profile would be ignored in silence."""
    path = tmp_path / "a.tif"
    for data, words in (
        (b"no profile at all" * 20, "is damaged"),
        (profile(P3, b"abcd" + bytes(20)), "is damaged|not one of three"),
        (profile(P3, GAMMA_2, names=("AXYZ", "BXYZ", "CXYZ")), "not one of three primaries|is damaged"),
    ):
        Image.fromarray(EIGHT).save(path, icc_profile=data)
        with pytest.raises(TwilightError, match=words):
            read_samples(path)


def test_png_gamma_and_primaries(tmp_path):
    """A PNG's own gamma and primaries would be ignored."""

    def chunk(name, *numbers):
        info = PngInfo()
        info.add(name, struct.pack(f">{len(numbers)}I", *numbers))
        return info

    z, path = EIGHT / 255.0, tmp_path / "a.png"
    Image.fromarray(EIGHT).save(path, pnginfo=chunk(b"gAMA", 50000))
    np.testing.assert_allclose(read_image(path, srgb_to_linear).samples, z**2, atol=1e-3)
    white_first = (*P3[6:], *P3[:6])
    Image.fromarray(EIGHT).save(path, pnginfo=chunk(b"cHRM", *(round(100000 * v) for v in white_first)))
    expected = srgb_to_linear(z) @ to_rec709(P3).T
    np.testing.assert_allclose(read_image(path, srgb_to_linear).samples, expected, atol=1e-4)


# Places


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation(tmp_path, suffix, orientation):
    """Pixels come upright, as Pillow turns them."""
    from PIL import ImageOps

    ramp = np.zeros((24, 48, 3), np.uint8)
    ramp[..., 0], ramp[..., 1] = np.arange(24)[:, None] * 8, np.arange(48) * 4
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a{suffix}"
    options = {"tiffinfo": {274: orientation}} if suffix == ".tif" else {"exif": exif}
    Image.fromarray(ramp).save(path, **options)
    expected = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    found = read_samples(path).samples
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected / 255.0, atol=1e-6)


def with_gpano(path, pixels, **said):
    words = " ".join(f'GPano:{name}="{value}"' for name, value in said.items())
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {words}/></rdf:RDF></x:xmpmeta>'
    )
    Image.fromarray(pixels).save(path, xmp=packet.encode(), quality=95)


CROP = {
    "FullPanoWidthPixels": 200,
    "FullPanoHeightPixels": 100,
    "CroppedAreaLeftPixels": 60,
    "CroppedAreaTopPixels": 10,
}
PIECE = CROP | {"CroppedAreaImageWidthPixels": 80, "CroppedAreaImageHeightPixels": 40}


@pytest.mark.parametrize("part", [1, 2])
def test_a_piece_of_a_panorama(tmp_path, part):
    """At its place in the whole, also where the file was made smaller afterwards; the rest is not taken for sky."""
    path = tmp_path / "a.jpg"
    pixels = np.full((40 // part, 80 // part, 3), 120, np.uint8)
    with_gpano(path, pixels, ProjectionType="equirectangular", **PIECE)
    found = read_samples(path)
    assert found.samples.shape == (100 // part, 200 // part, 3)
    rows, columns = slice(10 // part, 50 // part), slice(60 // part, 140 // part)
    np.testing.assert_allclose(found.samples[rows, columns], 120 / 255, atol=0.01)
    assert not found.saturated[rows, columns].any() and found.saturated.mean() == pytest.approx(0.84)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"ProjectionType": "cylindrical"}, "projection 'cylindrical'"),
        (PIECE | {"CroppedAreaLeftPixels": 150}, "cannot be"),
        (PIECE | {"PoseRollDegrees": 4.0}, "not level"),
    ],
)
def test_panoramas_that_are_refused(tmp_path, said, words):
    """A cylindrical, tilted or impossible panorama would be read as an upright sphere."""
    with_gpano(tmp_path / "a.jpg", np.full((40, 80, 3), 120, np.uint8), **said)
    with pytest.raises(TwilightError, match=words):
        read_samples(tmp_path / "a.jpg")


def test_pictures_as_met():
    """The same light, whatever its colours are said to be; the piece where it lies; what is upside down turned."""
    if not AS_MET.is_dir():
        pytest.skip(f"{AS_MET} is not here")
    plain = read_image(AS_MET / "plain.exr").samples
    for name in ("chrom-rec2020.exr", "chrom-xyz.exr"):
        np.testing.assert_allclose(read_image(AS_MET / name).samples, plain, rtol=2e-3, atol=1e-6)
    piece = read_image(AS_MET / "hugin-2to1.exr")
    assert piece.samples.shape[:2] == (512, 1024) and not piece.saturated[128:384, 256:768].any()
    assert piece.saturated.mean() == pytest.approx(0.75)
    srgb = read_image(AS_MET / "pano-srgb.jpg", srgb_to_linear).samples
    for name in ("pano-p3.jpg", "pano-orient3.jpg"):
        found = read_image(AS_MET / name, srgb_to_linear).samples
        # the rest is what 8 bits of other primaries round
        assert np.sqrt(np.mean((found - srgb) ** 2)) < 0.03 * srgb.mean()
        np.testing.assert_allclose(found.mean(axis=(0, 1)), srgb.mean(axis=(0, 1)), rtol=5e-3)


def adobe_of(pixels):
    primaries = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
    return (pixels / 255.0) ** 2.19921875 @ to_rec709(primaries).T


@pytest.mark.parametrize("said", [{0xA001: 65535, 0xA005: {1: "R03"}}, {0xA001: 2}])
def test_adobe_rgb_by_exif(tmp_path, said):
    """Adobe RGB that only EXIF states would be read as sRGB, with pale colours."""
    exif = Image.Exif()
    exif[0x8769] = said
    pixels = np.full((16, 16, 3), (200, 120, 60), np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    found = read_image(tmp_path / "a.jpg", srgb_to_linear).samples
    np.testing.assert_allclose(found, adobe_of(pixels), atol=5e-3)


def uncalibrated(path):
    exif = Image.Exif()
    exif[0x8769] = {0xA001: 65535}
    Image.fromarray(EIGHT).save(path, exif=exif)


def frames(path):
    Image.fromarray(EIGHT).save(path, save_all=True, append_images=[Image.fromarray(EIGHT // 2)])


@pytest.mark.parametrize(
    ("name", "make", "words"),
    [
        ("a.jpg", uncalibrated, "not sRGB .Exif ColorSpace 65535., and not which"),
        ("a.jpg", lambda path: Image.fromarray(EIGHT).convert("CMYK").save(path), "amounts of ink .CMYK"),
        ("a.tif", lambda path: Image.fromarray(EIGHT).convert("CMYK").save(path), "amounts of ink .CMYK"),
        ("a.png", frames, "holds 2 pictures"),
        ("a.tif", frames, "holds 2 pictures"),
        ("a.jpg", lambda path: with_gpano(path, EIGHT, FullPanoWidthPixels=80), "takes GPano:FullPanoWidthPixels and"),
    ],
)
def test_pictures_that_are_refused(tmp_path, name, make, words):
    """Ink, several frames or unknown colours would be read as some sRGB picture."""
    make(tmp_path / name)
    with pytest.raises(TwilightError, match=words):
        read_samples(tmp_path / name)


def test_a_preview_beside_the_picture_is_left(tmp_path):
    """A TIFF with a thumbnail would be refused, or the thumbnail be read."""
    small = Image.fromarray(EIGHT[:5, :10])
    Image.fromarray(EIGHT).save(tmp_path / "a.tif", save_all=True, append_images=[small])
    np.testing.assert_allclose(read_samples(tmp_path / "a.tif").samples, EIGHT / 255.0, atol=1e-6)


def patched(path, tag, value):
    """A TIFF in which one short number is another."""
    data = bytearray(path.read_bytes())
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    for k in range(struct.unpack_from(f"{order}H", data, start)[0]):
        if struct.unpack_from(f"{order}H", data, start + 2 + 12 * k)[0] == tag:
            struct.pack_into(f"{order}H", data, start + 2 + 12 * k + 8, value)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_white_may_be_zero(tmp_path, kind):
    """A TIFF in which 0 is white would be taken for its negative."""
    most = np.iinfo(kind).max
    ramp = np.round(np.linspace(0.0, 1.0, 40)[None, :, None] * np.ones((20, 1, 1)) * most).astype(kind)
    file = OpenImageIO.ImageOutput.create(str(tmp_path / "a.tif"))
    file.open(str(tmp_path / "a.tif"), OpenImageIO.ImageSpec(40, 20, 1, kind))
    file.write_image(ramp)
    file.close()
    found = read_samples(patched(tmp_path / "a.tif", 262, 0)).samples[..., 0]
    np.testing.assert_allclose(found, 1.0 - ramp[..., 0] / most, atol=1e-6)


CODES = {
    "linear": (1, 8, lambda light: light),
    "PQ in Rec. 2020": (9, 16, lambda light: pq(203.0 * light)),
    "sRGB in P3": (12, 13, linear_to_srgb),
}


def pq(cd_per_m2):
    """SMPTE ST 2084, the way to the file."""
    y = (cd_per_m2 / 1e4) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1.0 + 18.6875 * y)) ** 78.84375


@pytest.mark.parametrize("name", CODES)
def test_heif_whose_codes_alone_say_its_colours(tmp_path, name):
    """A HEIF in PQ or linear light, said by nclx and no profile, would be read as sRGB."""
    heif = pytest.importorskip("pillow_heif")
    primaries, curve, stored = CODES[name]
    light = np.ones((32, 64, 3)) * np.array([0.5, 0.4, 0.3]) * np.linspace(0.4, 1.0, 64)[None, :, None]
    own = light @ from_709({1: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290), 9: REC2020, 12: P3}[primaries]).T
    samples = np.round(65535 * stored(own)).astype(np.uint16)
    file = heif.from_bytes(mode="RGB;16", size=(64, 32), data=samples.tobytes())
    codes = {"color_primaries": primaries, "transfer_characteristics": curve}
    file.save(tmp_path / "a.heic", quality=-1, matrix_coefficients=0, full_range_flag=1, chroma=444, **codes)
    found = read_image(tmp_path / "a.heic", srgb_to_linear).samples
    np.testing.assert_allclose(found[4:-4, 4:-4], light[4:-4, 4:-4], rtol=0.03)
    file.save(tmp_path / "b.heic", color_primaries=10, transfer_characteristics=curve)
    with pytest.raises(TwilightError, match=f"primaries 10 and curve {curve} of ITU-T H.273"):
        read_samples(tmp_path / "b.heic")


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_light_behind_an_opacity_of_zero_names_the_channel(tmp_path, name):
    """Programs that render write light with A = 0: "no light" would leave its user without the cause."""
    if name == "a.exr":
        window = corners(0, 0, 40, 20)
        write_windows(tmp_path / name, LIGHT, window, window, np.zeros((20, 40), np.float32))
    else:
        Image.fromarray(np.dstack([EIGHT, np.zeros((20, 40), np.uint8)])).save(tmp_path / name)
    with pytest.raises(TwilightError, match=r"channel A \(alpha\) of zeros"):
        read_samples(tmp_path / name)
