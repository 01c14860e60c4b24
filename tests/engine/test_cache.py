"""The cache: the same sky without solving, within a limit, never a wrong one, and a sky where it cannot be written."""

import os
import resource

import numpy as np
import pytest
from typer.testing import CliRunner

import twilight
from twilight.base import cache
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.cli.app import app
from twilight.solvers.zones import solver

SCENE = {
    "sun_elevation_deg": -3.0,
    "wavelength_nm": [550.0],
    "quality": "draft",
    "settings": {"texture.resolution_deg": 30.0},
}


@pytest.fixture
def solved(tmp_path, monkeypatch, coarse_draft):
    """An empty cache, and the fields that were solved since."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    found = []
    solve = solver.solve

    def counted(*arguments):
        found.append(arguments)
        return solve(*arguments)

    monkeypatch.setattr(solver, "solve", counted)
    cache._warned.clear()
    return found


def files():
    return [file.path for file in cache.cached_files() if file.kind is cache.FIELDS]


def test_the_second_render_reads_what_the_first_has_solved(solved, monkeypatch):
    """The cache would solve again, give another sky, or take a limit of 0 for none."""
    first = twilight.render("pure-air", **SCENE)
    again = twilight.render("pure-air", **SCENE)
    assert len(solved) == 1 and len(files()) == 1
    np.testing.assert_array_equal(again.sun_normalised_radiance, first.sun_normalised_radiance)
    np.testing.assert_array_equal(again.direct_irradiance, first.direct_irradiance)
    assert again.provenance["field_from_disk"] and "field_from_disk" not in first.provenance
    assert again.provenance["convergence"] == first.provenance["convergence"]
    before = files()
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "0")
    twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": -2.0}))
    assert files() == before and len(solved) == 2


def test_whatever_enters_makes_another_field(solved):
    """The field of other air would be taken from the cache."""
    twilight.render("pure-air", **SCENE)
    changes = [
        {"sun_elevation_deg": -3.001}, {"wavelength_nm": [550.001]}, {"altitude_km": 0.001},
        {"settings": {"ground.albedo": 0.1501}}, {"settings": {"gases.ozone.column_du": 334.0}},
        {"settings": {"solver.max_orders": 7}},
    ]  # fmt: skip
    for number, change in enumerate(changes, start=2):
        settings = SCENE["settings"] | change.get("settings", {})
        twilight.render("pure-air", **(SCENE | change | {"settings": settings}))
        assert len(solved) == number and len(files()) == number, change


def test_a_damaged_field_is_solved_again(solved):
    """A damaged field would be shown."""
    first = twilight.render("pure-air", **SCENE)
    (path,) = files()
    whole = bytearray(path.read_bytes())
    for damaged in (whole[:1000], whole[: len(whole) // 2] + bytes(2000) + whole[len(whole) // 2 + 2000 :], b""):
        path.write_bytes(damaged)
        again = twilight.render("pure-air", **SCENE)
        np.testing.assert_array_equal(again.sun_normalised_radiance, first.sun_normalised_radiance)
    assert len(solved) == 4
    twilight.render("pure-air", **SCENE)
    assert len(solved) == 4


def test_the_field_used_longest_ago_goes_first(solved, monkeypatch):
    """The cache would grow, or lose what is used."""
    for index, sun in enumerate((-1.0, -2.0)):
        twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": sun}))
        for path in files():
            os.utime(path, (1e9 + index, path.stat().st_mtime if index else 1e9))
    twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": -1.0}))  # read: now the latest
    assert len(solved) == 2
    monkeypatch.setenv("TWILIGHT_CACHE_GB", str(2.5e-9 * files()[0].stat().st_size))
    twilight.render("pure-air", **SCENE)
    assert len(files()) == 2
    twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": -1.0}))
    assert len(solved) == 3


def test_a_folder_that_cannot_be_written_is_one_warning(solved, monkeypatch, tmp_path):
    """A read-only cache would be a traceback, or cost time without a word."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "file"))
    with pytest.warns(TwilightWarning, match=r"cache folder .*file cannot be written .* TWILIGHT_CACHE_DIR") as said:
        twilight.render("pure-air", **SCENE)
        twilight.render("pure-air", **SCENE)
    assert len(solved) == 2 and len(said) == 1


def test_a_full_cache_folder_is_one_warning(solved):
    """HDF5 on a full disk would crash; files larger than 20 kB cannot be written here."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.warns(TwilightWarning, match=r"cache folder .* cannot be written \(File too large\)"):
            sky = twilight.render("pure-air", **SCENE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert np.all(sky.sun_normalised_radiance > 0.0) and not files()
    assert not list(cache.cache_folder().rglob("*.part*"))


@pytest.mark.parametrize("text", ["much", "-1", "inf", "nan"])
def test_a_limit_must_be_a_number(monkeypatch, text):
    """A limit that is no number would be ignored."""
    monkeypatch.setenv("TWILIGHT_CACHE_GB", text)
    with pytest.raises(TwilightError, match=r"TWILIGHT_CACHE_GB: is .* allowed is a number of gigabytes"):
        cache.limit_bytes()


def test_the_command_shows_and_clears_every_kind(solved):
    """`twilight cache --clear` would leave files."""
    assert "nothing is cached" in CliRunner().invoke(app, ["cache"]).output
    twilight.render("pure-air", **SCENE)
    cache.store_arrays(cache.OPTICS, "key", {"row": np.arange(3.0)})
    shown = CliRunner().invoke(app, ["cache"]).output
    assert "solved fields" in shown and "optics of particles" in shown and "the limit is 1 GB" in shown
    cleared = CliRunner().invoke(app, ["cache", "--clear"])
    assert cleared.exit_code == 0 and "removed" in cleared.output and not list(cache.cached_files())


@pytest.mark.parametrize(
    "damage",
    [lambda raw: raw[:-1], lambda raw: raw[:150] + b"x" + raw[151:], lambda raw: b"x" + raw[1:], lambda raw: b""],
)
def test_a_damaged_array_counts_as_absent(solved, damage):
    """Damaged optics would be used."""
    cache.store_arrays(cache.OPTICS, "key", {"row": np.arange(6.0)})
    np.testing.assert_array_equal(cache.read_arrays(cache.OPTICS, "key")["row"], np.arange(6.0))
    path = cache.path_of(cache.OPTICS, "key")
    path.write_bytes(damage(path.read_bytes()))
    assert cache.read_arrays(cache.OPTICS, "key") is None
