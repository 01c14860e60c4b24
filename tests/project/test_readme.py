"""README and the pages that were its manual: set-up commands, documents, and what their Python computes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hazy_zones import SCALAR

from twilight.config import load_climate, load_series
from twilight.config.load import shipped
from twilight.solvers import zones

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MANUAL = "".join(
    (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("climates", "configurations", "solvers", "python")
)
MAPS = (ROOT / "docs" / "environment-maps.md").read_text(encoding="utf-8")
JOBS = "\n".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("sweeps", "two-codes"))


def blocks(language: str, text: str = README + MANUAL) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def test_two_commands_do_all_set_up_and_the_integration_runs_them():
    """README's commands would be others than those that CI tries."""
    lines = [line for block in blocks("sh", README) for line in block.splitlines()]
    set_up = [line for line in lines if line.startswith("python3 -m venv")]
    assert len(set_up) == 2
    assert "pip install ." in set_up[0] and "render climates/continental-average.yaml --sun-elevation -4" in set_up[0]
    assert "[test]" in set_up[1] and set_up[1].endswith("pytest -n 2")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    pattern = re.search(r"grep '([^']+)' README\.md", script)
    assert pattern is not None
    assert [line for line in README.splitlines() if re.match(pattern[1].replace("\\.", "[.]"), line)] == set_up


@pytest.mark.parametrize("text", blocks("yaml", README + MANUAL + JOBS))
def test_the_documents_shown_are_valid(text, tmp_path):
    """YAML shown in README or the guide would be refused."""
    for name in ("t1.csv", "smoke.csv", "smoke-phase.csv"):
        (tmp_path / name).touch()
    path = tmp_path / "document.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_series(path)


@pytest.fixture
def run_pieces(monkeypatch, tmp_path):
    """Runs pieces of Python one after the other as a reader would, in an empty folder; gives what they have named.

    `draft` is coarser here than it is, and fields are kept on disk as they are for a reader.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setitem(zones.QUALITIES, "draft", SCALAR)

    def run(pieces: list[str]) -> dict:
        namespace: dict = {}
        for number, piece in enumerate(pieces):
            exec(compile(piece, f"python piece {number}", "exec"), namespace)
        return namespace

    return run


def test_the_python_of_readme_runs(run_pieces):
    """README's Python would not run."""
    [piece] = blocks("python", README)
    assert "import twilight\n" in piece and "twilight.render(" in piece
    assert run_pieces([piece])["sky"].sun_elevation_deg == -4


@pytest.mark.slow
def test_the_python_of_the_manual_follows_it(run_pieces):
    """README's piece first; numbers of what the pages name are those of twilight."""
    namespace = run_pieces([*blocks("python", README), *blocks("python", MANUAL)])
    magnitudes = [sky.magnitude("V", elevation_deg=90) for sky in namespace["skies"]]
    assert len(magnitudes) == 3 and magnitudes == sorted(magnitudes)
    assert [sky.observer_altitude_km for sky in namespace["skies"]] == [0.17] * 3
    brightness = [sky.sum() for sky in namespace["sunset"]]
    assert brightness == sorted(brightness, reverse=True) and brightness[-1] > 0.0
    assert namespace["from_orbit"].min() > 0.0


def test_the_pictures_exist():
    """README would show broken pictures."""
    from PIL import Image

    names = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert names[0] == "docs/sunset.jpg"
    for name in names:
        with Image.open(ROOT / name) as picture:
            assert picture.width >= 400, name


def test_folders_hold_what_the_package_ships():
    """The climates beside README would differ from those that the program takes by name."""
    for kind in ("climates", "configs"):
        assert {path.name for path in (ROOT / kind).glob("*.yaml")} == {path.name for path in shipped(kind).values()}
    assert load_climate("continental-average") == load_climate(ROOT / "climates" / "continental-average.yaml")


def test_the_gallery_shows_twenty_skies_with_the_commands_that_make_them(monkeypatch):
    """The script reads the page: a command that it does not find would leave an old picture."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import pictures

    commands = pictures.gallery_commands()
    assert len(commands) == 20 == (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8").count("```sh")
    for name, command in commands.items():
        assert command.startswith("render ") and (ROOT / "docs" / "gallery" / f"{name}.jpg").stat().st_size < 60_000


def test_the_lamp_for_mitsuba_lights_a_floor_as_the_page_shows(monkeypatch, tmp_path):
    """The page's second piece of Python, beside a `sun.json` of a known sun."""
    import json

    import numpy as np
    from toy_sky import glow_sky

    from twilight.io.lamps import sun_facts

    pytest.importorskip("mitsuba")
    sky = replace(glow_sky(step_deg=30.0), sun_elevation_deg=30.0, sun_azimuth_deg=120.0)
    sky = replace(sky, direct_irradiance=np.full(sky.wavelength_nm.size, 0.5), apparent_sun_elevation_deg=30.0)
    (tmp_path / "sky").mkdir()
    facts = sun_facts(sky)
    (tmp_path / "sky" / "sun.json").write_text(json.dumps(facts))
    monkeypatch.chdir(tmp_path)
    [piece] = [p for p in blocks("python", MAPS) if '"directional"' in p]
    namespace: dict = {}
    exec(compile(piece, "lamp", "exec"), namespace)
    lit = np.array(namespace["mitsuba"].render(namespace["scene"], spp=4))[..., :3].max(axis=(0, 1))
    # a rectangle reflects half: albedo / pi times the irradiance on the level floor
    assert np.allclose(lit, 0.5 / np.pi * 0.5 * np.array(facts["irradiance_rgb_W_per_m2"]), rtol=1e-3)
