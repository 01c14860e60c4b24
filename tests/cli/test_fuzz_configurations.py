"""Configurations with faults in their data and in their text: accepted, or refused in one sentence."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import pytest
from fuzzing import ODD_YAML, Fault, attempt, check_message, limited, mutated_document, seeds
from rendering import TABLE
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.config import load_series
from twilight.engine import check_size
from twilight.scene.plan import make_plan
from twilight.scene.scene import count_suns

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
ROWS = (
    "0,450,0.02,0.1,0.9,0.7,0,0.0003\n0,600,0.007,0.08,0.9,0.7,0,0.0003\n"
    "60,450,1e-5,0,0.9,0.7,0,0\n60,600,1e-6,0,0.9,0.7,0,0\n"
)


def write_tables(folder: Path) -> None:
    """The tables that documents name."""
    (folder / "t1.csv").write_text(TABLE + ROWS)
    for table in (ROOT / "climates").glob("*.csv"):
        (folder / table.name).write_bytes(table.read_bytes())


@pytest.fixture
def place(tmp_path):
    write_tables(tmp_path)
    return tmp_path


def look_at(path: Path) -> None:
    """All that a render does with a configuration before the solver."""
    for case in load_series(path)[:20]:
        count_suns(case.config)
        check_size(case.config)
        make_plan(case.config)


@pytest.mark.parametrize("seed", range(4))
def test_faulty_configurations(place, seed):
    rng = random.Random(seed)
    documents = seeds(ROOT)
    path = place / "scene.yaml"
    accepted = 0
    for i in range(100):
        text = mutated_document(rng, documents)
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        accepted += attempt(lambda: look_at(path), f"seed {seed}, document {i}:\n{text[:2000]}")[0]
    assert 0 < accepted < 100


def test_seeds_are_valid(place):
    import yaml

    path = place / "scene.yaml"
    for document in seeds(ROOT):
        path.write_text(yaml.safe_dump(document))
        look_at(path)


@pytest.mark.parametrize("text", ODD_YAML)
def test_odd_yaml_everywhere(tmp_path, text):
    path = tmp_path / "scene.yaml"
    for document in (text, f"version: 1\nname: {text}\n", f"version: 1\naerosol:\n  type: {text}\n", f"sun: {text}"):
        path.write_bytes(document.encode("utf-8", "surrogatepass"))
        attempt(lambda: load_series(path), repr(document[:200]))
        attempt(lambda d=document: load_series("pure-air", {"sun": d, "solver": d}), repr(document[:200]))


def billion_laughs() -> str:
    levels = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
    return f"a0: &a0 [lol, lol]\n{levels}version: 1\nname: *a11\n"


def test_yaml_bombs(tmp_path):
    from twilight.solvers.analytic.coefficients import load_coefficients

    path = tmp_path / "bomb.yaml"
    for text in (billion_laughs(), "[" * 100_000, "{a: " * 50_000, "- " * 90_000 + "1", "a" * 900_000, "? " * 20_000):
        path.write_text(text)
        for read in (lambda: load_series(path), lambda: load_coefficients(str(path))):
            accepted, _ = attempt(read, text[:60])
            assert not accepted
    path.write_text("a: 1\n" * 2_000_000)
    for read in (lambda: load_series(path), lambda: load_coefficients(str(path))):
        accepted, message = attempt(read, "ten megabytes")
        assert not accepted and "kB" in message


NAMES = ("../../escape", "/escape", "..", ".", "~", "a/b", "a\\b", "con", "-rf", "--help", "a b", "a\nb", "é",
         "🌅" * 50, "x" * 100, "%s%n", "$(touch escape)", ";", "a:b", "\u202e")  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_names_stay_inside_the_output_folder(tmp_path, monkeypatch, name):
    """A scene's name, a climate's name and a value of `vary` name folders; nothing is written anywhere else."""
    import yaml

    home = tmp_path / "a" / "b"
    home.mkdir(parents=True)
    monkeypatch.chdir(home)
    document = {
        "version": 1, "name": name, "sun": {"elevation_deg": 20},
        "climate": {"version": 1, "name": name, "refraction": {"model": "none"}}, "wavelengths": {"list_nm": [550]},
        "solver": {"name": "cie"}, "texture": {"resolution_deg": 45}, "output": {"width": 8, "spectral_width": 8},
    }  # fmt: skip
    for more in ({}, {"vary": {"climate.description": [name, "other"]}}):
        (home / "scene.yaml").write_text(yaml.safe_dump(document | more, allow_unicode=True))
        with limited():
            result = CliRunner().invoke(app, ["render", "scene.yaml"])
        assert result.exit_code in (0, 2), (result.exception, result.stderr)
        if result.exit_code == 2:
            check_message(result.stderr, name)
    written = {p.relative_to(tmp_path).parts for p in tmp_path.rglob("*") if p.is_file()}
    assert all(parts[:3] in (("a", "b", "out"), ("a", "b", "scene.yaml")) for parts in written)
    assert len(written) > 1


def test_settings_of_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keys = ("sun", "climate", "solver.name", "vary", "name", "medium.table", "a.b.c", "", "=",
            "climate.medium.table", "texture.resolution_deg", "sun.elevations_deg", "é", "output.views", "vary.x", "\0",
            "climate.climate")  # fmt: skip
    for key in keys:
        for value in (*ODD_YAML, "../../etc/passwd", "/dev/zero", "\0", "1e999", "[1, 2]", "{}", "null"):
            result = CliRunner().invoke(app, ["render", "pure-air", "--plan", "--set", f"{key}={value}"])
            assert result.exit_code in (0, 2), (key, value, result.exception)
            if result.exit_code == 2:
                check_message(result.stderr, f"--set {key}={value[:100]}")
    assert list(tmp_path.iterdir()) == []


def test_things_that_are_not_files(tmp_path):
    import os

    from twilight.solvers.analytic.coefficients import load_coefficients

    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "endless.yaml").symlink_to("/dev/zero")
    for name in ("pipe.yaml", "loop.yaml", "folder.yaml", "endless.yaml", "x" * 5000 + ".yaml", "a\0.yaml"):
        path = str(tmp_path / name)
        for read in (
            lambda p=path: load_series(p),
            lambda p=path: load_series({"version": 1, "medium": {"table": p}}),
            lambda p=path: load_coefficients(p),
        ):
            accepted, _ = attempt(read, name[:40])
            assert not accepted


def test_the_command_itself_says_one_sentence(tmp_path):
    """The same through a true process, with its memory limited."""
    import resource

    def less_memory() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (4_000_000_000, 4_000_000_000))

    (tmp_path / "bomb.yaml").write_text(billion_laughs())
    (tmp_path / "garbage.yaml").write_bytes(bytes(range(256)))
    program = "import sys; sys.argv[0] = 'twilight'; from twilight.cli import main; main()"
    for arguments in (
        ["bomb.yaml"],
        ["garbage.yaml"],
        [
            "pure-air",
            "--set",
            "texture={azimuth_count: 7200, elevation_count: 1800}",
            "--set",
            "wavelengths.count=2000",
        ],
    ):
        result = subprocess.run(
            [sys.executable, "-c", program, "render", *arguments],
            cwd=tmp_path, capture_output=True, text=True, timeout=240, preexec_fn=less_memory,
        )  # fmt: skip
        assert result.returncode == 2, result.stderr
        check_message(result.stderr, str(arguments))
    assert {p.name for p in tmp_path.iterdir()} == {"bomb.yaml", "garbage.yaml"}


def test_the_fuzzer_finds_faults():
    """A traceback, a page of text, too much memory and an endless loop are all seen."""

    def of_a_page() -> None:
        raise RuntimeError("word " * 5000)

    def too_large() -> None:
        bytearray(8_000_000_000)

    def endless() -> None:
        with limited(seconds=1):
            while True:
                pass

    for action in (lambda: 1 / 0, of_a_page, too_large, endless):
        with pytest.raises(Fault):
            attempt(action, "x")
