"""Damaged files: what is read is refused in one sentence, or is whole in every way that a reader can check.

The readers of HDF5 and OpenEXR are libraries in C; a process of its own makes their crash a fault like any other.
"""

import os
import random
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzzing import Fault, attempt, damaged_bytes, damaged_table
from toy_sky import glow_sky

from twilight.base.errors import TwilightError

pytestmark = pytest.mark.slow

TABLE = (
    "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km,aerosol_single_scattering_albedo,"
    "aerosol_asymmetry,absorption_per_km,refractivity\n"
)


def whole_files(folder: Path) -> dict[str, bytes]:
    """One valid file of each kind that the program reads."""
    from importlib import resources

    from twilight.base import cache
    from twilight.io import write_rgb_exr, write_sky, write_spectral_exr

    sky = glow_sky(
        step_deg=15.0, wavelength_nm=(450.0, 600.0), direct_irradiance=np.array([0.5, 0.7]), sun_azimuth_deg=30.0,
        provenance={"configuration": {"name": "é", "list": [1, 2]}, "solver": "toy"},
    )  # fmt: skip
    write_sky(sky, folder / "sky.h5")
    write_rgb_exr(sky, folder / "rgb.exr", width=32)
    write_spectral_exr(sky, folder / "spectral.exr", width=16)
    cache.store_arrays(cache.OPTICS, "abc", {"row": np.arange(50.0)})
    rows = [
        f"{z},{w},{0.02 * s},{0.1 * s},0.9,0.7,0,{3e-4 * s}" for z, s in ((0, 1), (5, 0.3), (60, 0)) for w in (450, 600)
    ]
    radiances = [f"5,{e},{a},{w},0.01,0.0001" for e in (3, 60) for a in (0, 90) for w in (450, 600)]
    header = "sun_elevation_deg,elevation_deg,azimuth_deg,wavelength_nm,radiance_per_sr,standard_error_per_sr\n"
    return {
        "sky": (folder / "sky.h5").read_bytes(),
        "rgb": (folder / "rgb.exr").read_bytes(),
        "spectral": (folder / "spectral.exr").read_bytes(),
        "table": (TABLE + "\n".join(rows)).encode(),
        "coefficients": resources.files("twilight").joinpath("data/analytic/perez_preetham1999.yaml").read_bytes(),
        "references": (header + "\n".join(radiances)).encode(),
        "optics": cache.path_of(cache.OPTICS, "abc").read_bytes(),
    }


def readers() -> dict[str, Callable[[Path], Any]]:
    """How each kind is read; what is read must be whole."""
    from twilight.atmosphere.medium_table import medium_from_table
    from twilight.base import cache
    from twilight.io import read_latlong_exr, read_sky, read_spectral_exr
    from twilight.solvers.analytic.coefficients import load_coefficients
    from twilight.studies.compare.reference_solution import read_references

    def sky(path: Path) -> None:
        found = read_sky(path)
        assert np.all(np.isfinite(found.sun_normalised_radiance))
        assert found.sun_normalised_radiance.shape[2] == found.wavelength_nm.size

    def picture(path: Path) -> None:
        found = read_latlong_exr(path)
        assert found.rgb.ndim == 3

    def spectral(path: Path) -> None:
        wavelength, values, _ = read_spectral_exr(path)
        assert values.shape[2] == wavelength.size

    def table(path: Path) -> None:
        medium = medium_from_table(path)
        assert np.all(np.isfinite(medium.optical_depth()))
        medium_from_table(path, wavelength_nm=np.array([500.0]))

    def coefficients(path: Path) -> None:
        found = load_coefficients(str(path))
        luminance, _, _ = found.sky(found.turbidity[0], 90.0 - found.sun_zenith_deg[0], [0.0, 45.0], [0.0, 90.0])
        assert np.all(luminance > 0.0)

    def optics(path: Path) -> None:
        cache.path_of(cache.OPTICS, "abc").write_bytes(path.read_bytes())
        found = cache.read_arrays(cache.OPTICS, "abc")
        if found is None:
            raise TwilightError("counts as absent")
        assert np.array_equal(found["row"], np.arange(50.0))

    return {"sky": sky, "rgb": picture, "spectral": spectral, "table": table, "coefficients": coefficients,
            "references": read_references, "optics": optics}  # fmt: skip


def damage(rng: random.Random, kind: str, whole: bytes) -> bytes:
    if kind in ("table", "references") and rng.random() < 0.8:
        return damaged_table(rng, whole.decode()).encode("utf-8", "surrogatepass")
    while True:
        damaged = damaged_bytes(rng, whole)
        heaps = [found.start() for found in re.finditer(b"GCOL", whole)] if kind == "sky" else []
        # HDF5 (up to 2.0) may never return from a damaged global heap
        if all(damaged[at : at + 4] != b"GCOL" or damaged[at : at + 4096] == whole[at : at + 4096] for at in heaps):
            return damaged


def main(folder: Path, kind: str, seed: int, count: int) -> None:
    """Read `count` damaged files of a kind; the number of the file is on disk before it is read."""
    os.environ["TWILIGHT_CACHE_DIR"] = str(folder)
    whole = whole_files(folder)[kind]
    read = readers()[kind]
    suffix = {"sky": ".h5", "rgb": ".exr", "spectral": ".exr", "table": ".csv", "references": ".csv",
              "coefficients": ".yaml"}.get(kind, ".bin")  # fmt: skip
    path = folder / f"damaged{suffix}"
    path.write_bytes(whole)
    assert attempt(lambda: read(path), f"whole {kind}")[0]
    accepted = 0
    for i in range(count):
        path.write_bytes(damage(random.Random(f"{kind}/{seed}/{i}"), kind, whole))
        try:
            accepted += attempt(lambda: read(path), f"{kind}, seed {seed}, file {i}")[0]
        except Fault as fault:
            print(f"fault: {' '.join(str(fault).split())}")
    print(f"{accepted} accepted")


def run(folder: Path, kind: str, seed: int, count: int) -> tuple[int, list[str]]:
    """(files accepted, faults) of a process that reads damaged files; a crash is a fault."""
    folders = [str(parent) for parent in Path(__file__).parents[:2]]
    program = f"import sys; sys.path[:0] = {folders!r}; import test_fuzz_files as t; "
    program += f"from pathlib import Path; t.main(Path({str(folder)!r}), {kind!r}, {seed}, {count})"
    command = [sys.executable, "-X", "faulthandler", "-c", program]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    lines = result.stdout.splitlines()
    faults = [line for line in lines if line.startswith("fault: ")]
    if result.returncode:
        return 0, [*faults, f"{kind}, seed {seed}: exit code {result.returncode}: {result.stderr[-800:]}"]
    return int(lines[-1].split()[0]), faults


@pytest.mark.parametrize("kinds", [("sky", 60), ("rgb", 150), ("spectral", 100), ("table", 200), ("coefficients", 60)])
def test_damaged_files(tmp_path, kinds):
    """A damaged file would be read as a whole one, or crash its library."""
    kind, count = kinds
    accepted, faults = run(tmp_path, kind, 0, count)
    assert not faults, "\n".join(faults[:5])
    assert accepted < count


@pytest.mark.parametrize("kind", ["references", "optics"])
def test_damaged_files_in_this_process(tmp_path, kind, capsys):
    """A damaged reference or cache entry would be used."""
    main(tmp_path, kind, 0, 100)
    out = capsys.readouterr().out
    assert "fault" not in out, out
    assert int(out.split()[-2]) < 100


def test_a_file_that_claims_to_be_gigantic_is_refused_with_its_size(tmp_path):
    """Memory would be taken for what a header claims."""
    import h5py

    from twilight.io import read_latlong_exr, read_sky, write_rgb_exr, write_sky

    write_sky(glow_sky(step_deg=15.0), tmp_path / "sky.h5")
    with h5py.File(tmp_path / "sky.h5", "a") as file:
        file.create_dataset("huge", shape=(10**6, 10**6), dtype="f8", chunks=(1000, 1000))
    accepted, message = attempt(lambda: read_sky(tmp_path / "sky.h5"), "huge.h5")
    assert not accepted and "GB" in message and "kB" in message, message
    write_rgb_exr(glow_sky(step_deg=15.0), tmp_path / "rgb.exr", width=32)
    raw = bytearray((tmp_path / "rgb.exr").read_bytes())
    at = raw.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    raw[at + 8 : at + 16] = (60_000).to_bytes(4, "little") * 2
    (tmp_path / "rgb.exr").write_bytes(raw)
    accepted, message = attempt(lambda: read_latlong_exr(tmp_path / "rgb.exr"), "huge.exr")
    assert not accepted and "GB" in message, message
