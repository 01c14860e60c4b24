"""A render of a sequence that is interrupted at random moments: what was finished is whole, the next run is clean."""

import json
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rendering import FILES

from twilight.io import read_latlong_exr, read_sky, read_spectral_exr

pytestmark = pytest.mark.slow

SUNS = [40, 30, 20, 10, 5]
SCENE = f"""\
version: 1
climate: {{version: 1, name: test, refraction: {{model: none}}}}
sun: {{elevations_deg: {SUNS}}}
wavelengths: {{list_nm: [420, 490, 560, 630, 700]}}
solver: {{name: cie, turbidity: 3}}
texture: {{azimuth_count: 36, elevation_count: 9}}
output: {{width: 64, spectral_width: 32}}
"""
PROGRESS = re.compile(r"twilight: +\d+ %, ")
"""A line that tells of a long render's progress, every few seconds."""
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}


def start(folder: Path) -> subprocess.Popen:
    (folder / "scene.yaml").write_text(SCENE)
    program = "from twilight.cli import main; main()"
    command = [sys.executable, "-c", program, "render", "scene.yaml", "--output", "sky"]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def whole(file: Path) -> object:
    """The content of a file; an error where it is not whole."""
    if file.suffix == ".json":
        return json.loads(file.read_text(encoding="utf-8"))
    if file.suffix == ".usda":
        text = file.read_text(encoding="utf-8")
        assert text.startswith("#usda") and text.rstrip().endswith("}")
        return text
    if file.name.endswith(".rgb.exr"):
        return read_latlong_exr(file).rgb
    if file.name.endswith(".spectral.exr"):
        return read_spectral_exr(file)[1]
    if file.suffix == ".h5":
        return read_sky(file).sun_normalised_radiance
    from PIL import Image

    with Image.open(file) as picture:
        picture.load()
        return np.asarray(picture)


def finished(out: Path) -> dict[str, float]:
    """Every file under its final name, with its time of change; each is read to its end."""
    found = {}
    for file in [*sorted(out.glob("sun*/*")), *out.glob("contact-sheet.png")]:
        if file.is_file() and not file.name.startswith("."):
            whole(file)
            found[str(file.relative_to(out))] = file.stat().st_mtime
    return found


def leftovers(out: Path) -> list[Path]:
    return [p for p in out.parent.rglob(".*")]


def check_stopped(process: subprocess.Popen, number: int, folder: Path) -> dict[str, float]:
    """Send a signal and look at what is left."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=300)
    out = folder / "sky"
    if process.returncode == 0:  # it was done before
        assert len(finished(out)) == len(SUNS) * len(FILES) + 1
    else:
        assert process.returncode == CODES[number], errors
        assert "Traceback" not in errors
        if number != signal.SIGKILL:
            said = [line for line in errors.splitlines() if not PROGRESS.match(line)]
            assert len(said) == 1 and said[0].startswith("twilight: "), errors
    left = leftovers(out)
    if number == signal.SIGKILL:  # nobody can tidy up then; what is left cannot be taken for a result
        assert len(left) <= 1 and all(".part" in p.name or p.name.startswith(".twilight-") for p in left), left
    else:
        assert not left, left
    return finished(out)


def wait_for_files(process: subprocess.Popen, out: Path, count: int) -> None:
    """Wait until the render has written so many files, or has ended."""
    while process.poll() is None and (not out.exists() or sum(1 for p in out.rglob("s??.*") if p.is_file()) < count):
        time.sleep(0.002)


def check_next_run(folder: Path, before: dict[str, float]) -> None:
    """The same command again gives everything, and leaves nothing else behind that it made."""
    process = start(folder)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert not [p for p in leftovers(folder / "sky") if ".part" in p.name and p.parent.name != "sky"]
    after = finished(folder / "sky")
    assert set(before) <= set(after)
    frames = {name.split("/")[0] for name in after if "/" in name}
    assert len(frames) == len(SUNS)
    assert all({name for name in after if name.startswith(f"{f}/")} == {f"{f}/{n}" for n in FILES} for f in frames)


def interrupted_render(folder: Path, number: int, rng: random.Random) -> dict[str, float]:
    process = start(folder)
    try:
        wait_for_files(process, folder / "sky", rng.randrange(1, len(SUNS) * len(FILES) - 4))
        time.sleep(rng.random() * 0.05)  # within a file, between files, between frames
        return check_stopped(process, number, folder)
    finally:
        process.kill()


@pytest.mark.parametrize("number", list(CODES))
@pytest.mark.parametrize("seed", range(2))
def test_random_moments(tmp_path, number, seed):
    """A half file would stand under a final name, or the next run trip over it."""
    before = interrupted_render(tmp_path, number, random.Random(f"{number} {seed}"))
    check_next_run(tmp_path, before)


@pytest.mark.parametrize("number", list(CODES))
@pytest.mark.parametrize("seed", range(3))
def test_moments_while_it_starts(tmp_path, number, seed):
    """During imports, reading and setting up: no traceback once Python runs the program, and no files."""
    process = start(tmp_path)
    time.sleep(random.Random(f"{number} {seed}").random() * 3.0)
    process.send_signal(number)
    process.communicate(timeout=300)
    assert process.returncode in (0, CODES[number], -number)  # -number: before Python could catch it
    finished(tmp_path / "sky")
    if number != signal.SIGKILL:
        assert not leftovers(tmp_path / "sky")
