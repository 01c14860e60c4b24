"""Files that say that they hold more than they should: refused with the sizes, before memory is taken for them."""

import io
import resource
import zipfile
import zlib
from contextlib import contextmanager

import numpy as np
import pytest
from toy_sky import glow_sky

from twilight.base import reading
from twilight.base.errors import TwilightError
from twilight.base.reading import check_expansion, open_npz


@contextmanager
def little_memory(megabytes=300):
    """Memory that may be taken on top of what this process has: more ends in a MemoryError, which is a failure."""
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + megabytes * 2**20, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def npy(shape, dtype="<f8", data=b""):
    """A .npy file whose header says more than it holds."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue() + data


def test_an_hdf5_field_of_1e12_elements(tmp_path):
    """Memory would be taken for what an HDF5 header claims."""
    import h5py

    from twilight.solvers.zones import load
    from twilight.solvers.zones.storage import FORMAT

    path = tmp_path / "field.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = FORMAT
        file.create_group("medium").create_dataset("altitude_km", shape=(10**12,), dtype="f8", chunks=(1000,))
    with little_memory(), pytest.raises(TwilightError, match=r"8e\+03 GB, but its .* kB cannot"):
        load(path)


def test_a_library_whose_arrays_are_larger_than_the_file(tmp_path):
    """Memory would be taken for what a .npy header claims."""
    path = tmp_path / "state.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("fingerprint.npy", npy((10**12,)))
    with little_memory(), pytest.raises(TwilightError, match=r"says that it holds 8e\+03 GB"), open_npz(path) as stored:
        stored["fingerprint"]


def test_what_fits_into_the_file_and_not_into_the_machine(tmp_path, monkeypatch):
    """A whole file would fill the machine."""
    (tmp_path / "a").write_bytes(bytes(1000))
    check_expansion(tmp_path / "a", 2e6)
    monkeypatch.setattr(reading, "memory_bytes", lambda: 3e6)
    with pytest.raises(TwilightError, match=r"a: holds 0.002 GB, more than half of this machine's 0.003 GB"):
        check_expansion(tmp_path / "a", 2e6)


def test_pictures_are_measured_before_they_are_read(tmp_path):
    """Memory would be taken for what a picture's header claims."""
    from PIL import Image

    from twilight.io import write_rgb_exr
    from twilight.io.stored_image import read_image

    def chunk(kind, data):
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    size = (30_000).to_bytes(4, "big")
    head = chunk(b"IHDR", size * 2 + b"\x10\x02\0\0\0")
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(1000))))
    Image.new("L", (4, 4)).save(tmp_path / "b.tif")
    raw = bytearray((tmp_path / "b.tif").read_bytes())
    entry = raw.index(b"\x00\x01\x04\x00") if b"\x00\x01\x04\x00" in raw else raw.index(b"\x00\x01\x03\x00")
    raw[entry : entry + 24] = b"".join(
        tag.to_bytes(2, "little") + b"\x04\0\x01\0\0\0" + (30_000).to_bytes(4, "little") for tag in (256, 257)
    )
    (tmp_path / "b.tif").write_bytes(raw)
    write_rgb_exr(glow_sky(step_deg=30.0), tmp_path / "c.exr", width=32)
    raw = bytearray((tmp_path / "c.exr").read_bytes())
    at = raw.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    raw[at + 8 : at + 16] = (29_999).to_bytes(4, "little") * 2
    (tmp_path / "c.exr").write_bytes(raw)
    (tmp_path / "d.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n" + bytes(1000))
    for name in ("a.png", "b.tif", "c.exr", "d.hdr"):
        with (
            little_memory(),
            pytest.raises(TwilightError, match=r"30000 x 30000 pixels; at most 4e|MB image from a \d+ byte file"),
        ):
            read_image(tmp_path / name)
