"""Damaged photographs, cameras, curves and masks: read, or refused in one sentence."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from fuzzing import attempt, damaged_bytes, damaged_table

from twilight.io.stored_image import read_image, write_exr
from twilight.studies.camera.model import read_camera
from twilight.studies.camera.response import read_response
from twilight.studies.validate.photographs.mask import read_mask_image

CAMERA = """version: 1
projection: equisolid
image: {width_px: 48, height_px: 32}
lens: {focal_length_px: 12.0, distortion: [0.01, 0.002]}
orientation: {azimuth_deg: 20, elevation_deg: 70, roll_deg: 3}
response: srgb
"""
CURVE = "sample,red,green,blue\n0,0,0,0\n0.25,0.05,0.05,0.06\n0.5,0.2,0.2,0.2\n0.75,0.5,0.5,0.5\n1,1,1,1\n"
COUNT = 40


def whole(folder: Path, name: str) -> None:
    """Write a file that is right."""
    path = folder / name
    rgb = np.random.default_rng(1).uniform(0.01, 1.0, (32, 48, 3))
    if path.suffix == ".exr":
        write_exr(path, rgb)
    elif path.suffix in (".png", ".jpg", ".tif"):
        from PIL import Image

        Image.fromarray((rgb * 255).astype(np.uint8)).save(path)
    elif path.suffix == ".hdr":
        flat = b"".join(bytes((*np.clip(p * 128, 0, 255).astype(int).tolist(), 129)) for p in rgb.reshape(-1, 3))
        path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 48\n" + flat)
    else:
        path.write_text({"camera.yaml": CAMERA, "curve.csv": CURVE}[name])


KINDS = {
    "photo.hdr": read_image,
    "photo.exr": read_image,
    "photo.png": read_image,
    "photo.jpg": read_image,
    "photo.tif": read_image,
    "mask.png": read_mask_image,
    "camera.yaml": read_camera,
    "curve.csv": read_response,
}


@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_of_a_photograph(tmp_path, name):
    """A damaged picture, camera, curve or mask would end in a traceback."""
    whole(tmp_path, name)
    path, read = tmp_path / name, KINDS[name]
    assert attempt(lambda: read(path), name) == (True, "")
    right = path.read_bytes()
    refused = 0
    for i in range(COUNT):
        rng = random.Random(f"{name}/{i}")
        table = path.suffix == ".csv" and rng.random() < 0.8
        damaged = damaged_table(rng, right.decode()).encode("utf-8", "surrogatepass") if table else None
        path.write_bytes(damaged_bytes(rng, right) if damaged is None else damaged)
        refused += not attempt(lambda: read(path), f"{name}, file {i}")[0]
    assert refused
