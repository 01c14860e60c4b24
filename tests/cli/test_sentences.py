"""What a user reads of bad input: one sentence, exit code 2, before anything is computed or written.

`tests/data/sentences.txt` has the words of a command behind `$`, and below them the sentence to the letter; CLIMATES/
and CONFIGS/ is where those are that come with the program.
"""

import os
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.config.load import shipped
from twilight.solvers import zones

GOLDEN = Path(__file__).resolve().parents[1] / "data" / "sentences.txt"
FOUND = re.findall(r"^\$ (.*)\n(.*)$", GOLDEN.read_text(encoding="utf-8"), re.MULTILINE)
SHIPPED = {kind.upper(): f"{next(iter(shipped(kind).values())).parent}{os.sep}" for kind in ("climates", "configs")}
CLIMATE = "version: 1\nname: x\n"
TABLE = (
    "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km,aerosol_single_scattering_albedo,"
    "aerosol_asymmetry,absorption_per_km,refractivity\n"
)
LEVELS = "altitude_km,pressure_hpa,temperature_k,water_vapour_ppm,ozone_ppm\n"
FILES = {
    "latin.yaml": b"name: \xff\xfe",
    "long.yaml": b"a: " + b"x" * 2_000_000,
    "broken.yaml": "version: 1\nname: [a",
    "twice.yaml": "version: 1\nversion: 1",
    "alias.yaml": "a: &x 1\nb: *x",
    "infinite.yaml": CLIMATE + "ground: {albedo: -.inf}",
    "number.yaml": "1: 2",
    "python.yaml": "a: !!python/object/apply:os.getcwd []",
    "deep.yaml": "[" * 1000,
    "text.yaml": "just text",
    "empty.yaml": "",
    "version.yaml": "name: x",
    "version-2.yaml": "version: '1'\nname: x",
    "no-table.yaml": "version: 1\nmedium: {}",
    "one.yaml": "version: 1\nclimate: pure-air\nsun: {elevation_deg: 3}",
    "series.yaml": "version: 1\nclimate: pure-air\nvary: {ground.albedo: [0, 1]}",
    "T1.yaml": "version: 1\nname: T1\nmedium: {table: t1.csv}\nground: {albedo: 0.0}",
    "t1.csv": TABLE + "".join(f"{z},{nm},0.01,0.05,0.9,0.7,0,0\n" for z in (0, 60) for nm in (420, 645)),
    "celsius.csv": LEVELS + "0,1013,17,9000,0.03\n100,0.0003,195,1,0.5\n",
    "metres.csv": LEVELS + "0,1013,290,9000,0.03\n100000,0.0003,195,1,0.5\n",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sentences")
    for name, content in FILES.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "folder.png").mkdir()
    (folder / "folder.gif").mkdir()
    (folder / "folder.yaml").mkdir()
    os.mkfifo(folder / "pipe.yaml")
    return folder


@pytest.mark.parametrize(("words", "sentence"), FOUND, ids=[words for words, _ in FOUND])
def test_bad_input_is_one_sentence(folder, monkeypatch, words, sentence):
    """A slip would be a traceback, or a picture of something else."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(zones, "prepare", lambda *_, **__: pytest.fail("computes"))
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    result = CliRunner().invoke(app, shlex.split(words))
    said = result.stderr
    for name, place in SHIPPED.items():
        said = said.replace(place, f"{name}/")
    assert (result.exit_code, said) == (2, f"twilight: {sentence}\n"), result.exception
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()} == before
