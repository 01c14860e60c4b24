"""Any value of any key, and any text: accepted, or refused in one sentence."""

import random
from pathlib import Path

import pytest
from fuzzing import NASTY, ODD_YAML, Fault, attempt, check_message, dotted_keys, limited
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.config import Climate, Config, load_series
from twilight.engine import check_size
from twilight.scene.plan import make_plan
from twilight.scene.suns import count_suns
from twilight.solvers.analytic.coefficients import load_coefficients

KEYS = sorted({*dotted_keys(Config), *dotted_keys(Climate), "solver.name", "solver.quality", "solver.expert", "vary.x"})
KEYS = [key for key in KEYS if not key.startswith("climate.")]


def look_at(target: str | Path, settings: dict | None = None) -> None:
    """All that a render does with a configuration before the solver."""
    for case in load_series(target, settings)[:20]:
        count_suns(case.config)
        check_size(case.config)
        make_plan(case.config)


@pytest.mark.parametrize("count", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_any_value_of_any_key(count):
    """A traceback instead of a sentence, for a value that nobody thought of."""
    rng, accepted = random.Random(count), 0
    for key in KEYS:
        for value in rng.sample(NASTY, count):
            climate = "haber2005-air" if rng.random() < 0.2 else "urban"
            accepted += attempt(lambda k=key, v=value, c=climate: look_at(c, {k: v}), f"{key}={value!r}"[:200])[0]
    assert 0 < accepted < count * len(KEYS)


@pytest.mark.slow
@pytest.mark.parametrize("text", ODD_YAML)
def test_any_text(tmp_path, text):
    """A document, a value or a setting of the command line that YAML reads in an unexpected way, or not at all."""
    path = tmp_path / "scene.yaml"
    for document in (text, f"version: 1\nname: {text}\n", f"version: 1\naerosol:\n  type: {text}\n", f"sun: {text}"):
        path.write_bytes(document.encode("utf-8", "surrogatepass"))
        attempt(lambda: load_series(path), repr(document[:200]))
    for key in ("sun", "climate", "a.b.c", "", "="):
        result = CliRunner().invoke(app, ["render", "pure-air", "--plan", "--set", f"{key}={text}"])
        assert result.exit_code in (0, 2), (key, text, result.exception)
        if result.exit_code == 2:
            check_message(result.stderr, f"--set {key}={text[:100]}")


def billion_laughs() -> str:
    levels = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
    return f"a0: &a0 [lol, lol]\n{levels}version: 1\nname: *a11\n"


@pytest.mark.slow
def test_yaml_bombs(tmp_path):
    """A document of a few kB would take all the memory."""
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_things_that_are_not_files(tmp_path):
    """A pipe or a device would hang the program."""
    import os

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


@pytest.mark.slow
def test_the_fuzzer_finds_faults():
    """A traceback, too much memory and an endless loop are all seen."""

    def too_large() -> None:
        bytearray(8_000_000_000)

    def endless() -> None:
        with limited(seconds=1):
            while True:
                pass

    for action in (lambda: 1 / 0, too_large, endless):
        with pytest.raises(Fault):
            attempt(action, "x")
