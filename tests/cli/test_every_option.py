"""Every option of every command changes what is asked of the rest of the program, or its refusal says why.

The commands run with what computes replaced by mocks: what reaches these, what is printed and how a command ends is
compared with and without the option.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

import pytest
import typer
from typer.testing import CliRunner

from twilight.cli.app import app

PLACE = ["--latitude", "48", "--longitude", "11"]
SET = {"--set": "ground.albedo=0.7"}
QUALITY = {"--quality": "draft"}
OUTPUT = "elsewhere"
PHOTO = {
    "--camera": "camera.yaml", "--field-of-view": "60", "--white-balance": None,
    "--sun-azimuth": "100", "--profile": "line.csv",
    "--mask": "sky.png", "--no-automatic-mask": None, "--min-elevation": "8", "--glare": "11", "--resolution": "5",
    "--output": "taken/inside", "--set": "climate.ground.albedo=0.7",
}  # fmt: skip
READ = ["twilight.studies.validate.photographs.photograph.read_photograph", "twilight.studies.camera.read_camera"]

Case = tuple[list[str], list[str], dict[str, str | list[str] | None]]
"""What is replaced by mocks, the words of a command, and for each of its options a value, or words; None: a flag."""

CASES: dict[str, Case] = {
    "render": (
        ["twilight.cli.render_files.render_files", "twilight.cli.render_files.render_one_file"],
        ["pure-air", "--sun-elevation", "5"],
        {
            "--sun-elevation": "4", "--at": "2026-06-21",
            "--latitude": [*PLACE[:2], "--at", "2026-06-21"], "--longitude": [*PLACE[2:], "--at", "2026-06-21"],
            "--time-zone": "Europe/Berlin", "--altitude-km": "2", "--solver": "cells",
            "--target-stderr": ["--target-stderr", "0.1", "--solver", "montecarlo"], "--target-error": "0.01",
            "--renderer": "blender", "--width": "512", "--exposure": "11", "--tone": "gamma", "--only": "png",
            "--projection": "fisheye", "--size": ["--size", "32x32", "--projection", "fisheye"], "--polariser": "20",
            "--disc": None, "--output": OUTPUT, "--overwrite": None, "--no-preview": None, "--plan": None,
            **QUALITY, **SET,
        },
    ),
    "view": (
        ["twilight.engine.solve", "twilight.show.view_fields"],
        ["pure-air"],
        {"--beside": "urban", "--altitudes-km": "0,2", "--output": "x.html", **QUALITY, **SET},
    ),
    "animate": (
        ["twilight.show.film.Animation"],
        ["pure-air", "--output", "film.gif"],
        {
            "--output": "film.webp", "--from": "7", "--to": "-3", "--speed": "100", "--frames": "9",
            "--frames-per-second": "10", "--exposure": "constant", "--tone": "gamma", "--projection": "fisheye",
            "--width": "60", "--height": "60", "--disc": None, **QUALITY, **SET,
        },
    ),
    "sweep": (
        ["twilight.studies.sweep.sweep.Sweep", "twilight.config.load.warn_of_slips",
         "twilight.cli.sweep.run_sweep_into", "twilight.cli.sweep.print_plan"],
        ["sweep-compact", "--output", "a.zarr"],
        {
            "--scheduler": "tcp://10.0.0.1:8786", "--batch-system": "slurm", "--workers": "1", "--threads": "1",
            "--output": "b.zarr", "--plan": None, "--set": "solver.name=zones",
        },
    ),
    "timeline": (
        ["twilight.engine.light.field_for", "twilight.studies.timeline.timeline.timeline",
         "twilight.studies.timeline.files.write_table", "twilight.cli.timeline._print"],
        ["pure-air", *PLACE, "--at", "2026-06-21", "--output", "x.csv"],
        {
            "--latitude": "50", "--longitude": "12", "--at": "2026-06-22", "--for": "reading",
            "--quantity": "luminance@zenith", "--when": "V@zenith > 20", "--step": "1h",
            "--start": "2026-06-21T20:00Z", "--stop": "2026-06-21T23:00Z", "--time-zone": "Europe/Berlin",
            "--altitude-km": "2", "--output": "y.csv", **QUALITY, **SET,
        },
    ),
    "light": (
        ["twilight.api.light.light"],
        ["pure-air", *PLACE, "--at", "2026-06-21T12:00Z"],
        {
            "--at": "2026-06-21T13:00Z", "--latitude": "50", "--longitude": "12", "--quantity": "cct",
            "--towards": "30/90", "--source": "sun", "--time-zone": "Europe/Berlin", "--altitude-km": "2",
            **QUALITY, **SET,
        },
    ),
    "times": (
        [],
        [*PLACE, "--date", "2026-06-21"],
        {
            "--latitude": "50", "--longitude": "12", "--date": "2026-06-22", "--time-zone": "Europe/Berlin",
            "--altitude-km": "2",
        },
    ),
    "compare": (
        ["twilight.studies.compare.bench.Bench", "twilight.studies.compare.comparison.compare",
         "twilight.studies.compare.ablations.ablate", "twilight.studies.compare.reference_solution.ReferenceSolver",
         "twilight.studies.compare.reference_solution.write_references", "twilight.studies.compare.report.draw",
         "twilight.studies.compare.reference_solution.read_references"],
        ["pure-air", "--sun-elevation", "5"],
        {
            "--solvers": "cells", "--sun-elevation": "4", "--reference": "reference.csv", "--add": "missing.csv",
            "--reference-stderr": "0.01", "--directions": "12", "--time-limit": "100", "--repeats": "1",
            "--ablations": "ozone", "--output": OUTPUT, **SET,
        },
    ),
    "fit perez": (
        ["twilight.studies.fit.truth.compute_truth", "twilight.studies.fit.perez.fit_set",
         "twilight.studies.fit.truth.error_of", "twilight.studies.fit.truth.write_set", "twilight.engine.frames"],
        [],
        {
            "--per-sky": None, "--sun-elevation": ["--per-sky", "--sun-elevation", "20"], "--haze": "scaled",
            "--solver": "cells", "--output": "taken/x.yaml", **QUALITY, **SET,
        },
    ),
    "export shader": (
        ["twilight.engine.solve", "twilight.show.shader.shader_sky", "twilight.studies.export.prague.write_folder"],
        ["pure-air"],
        {"--output": OUTPUT, **QUALITY, **SET},
    ),
    "export prague": (
        ["twilight.studies.export.prague_air.airs_of", "twilight.studies.export.prague.PragueMaker",
         "twilight.studies.export.prague_file.PragueAxes", "twilight.studies.export.prague_file.write_prague"],
        ["urban", "--output", "a.dat"],
        {
            "--output": "b.dat", "--layout": "full", "--visibility": "20", "--albedo": "0.3", "--channels": "5",
            "--start-nm": "400", "--width-nm": "20", "--nodes": "3", "--rank": "4", "--polarisation": None,
            "--quality": "standard",
        },
    ),
    "validate photo": (
        [*READ, "twilight.cli.validate_photo.compare_with_sky"],
        ["a.jpg", "--config", "pure-air"],
        {"--config": "urban", "--polariser": "20", **PHOTO},
    ),
    "validate estimate": (
        [*READ, "twilight.estimate", "twilight.cli.validate.write_comparison"],
        ["a.jpg"],
        {
            "--config": "urban", "--sun-elevation": "4", "--types": "urban", "--parameters": "none", "--refine": None,
            "--no-colour": None, "--no-brightness": None, "--tone-curve": None, "--no-tone-curve": None,
            "--no-white-balance": None, **PHOTO,
        },
    ),
    "validate response": (
        ["twilight.studies.camera.image.read_samples", "twilight.studies.camera.response.recover_response",
         "twilight.studies.camera.response.load_response", "twilight.studies.camera.response.check_bracket",
         "twilight.studies.camera.response.write_response", "twilight.studies.camera.response.merge_bracket",
         "twilight.studies.camera.image.write_exr"],
        ["a.jpg", "b.jpg", "--times", "0.1,1"],
        {
            "--times": "0.1,2", "--merge": "m.exr", "--curve": ["--curve", "srgb", "--merge", "m.exr"],
            "--output": "r.csv",
        },
    ),
    "validate photometry": (
        ["twilight.studies.validate.measured.photometry.photometry"],
        ["pure-air"],
        {"--output": ["--output", "taken/inside"], **QUALITY, **SET},
    ),
    "validate spectra": (
        ["twilight.studies.validate.measured.spectra.read_spectra",
         "twilight.studies.validate.measured.spectra.at_nodes", "twilight.studies.validate.measured.spectra.bases",
         "twilight.studies.validate.measured.spectra.on_own_day", "twilight.studies.validate.measured.spectra.fit"],
        ["a.csv"],
        {
            "--config": "urban", "--series": "4", "--suns": "0,-6", "--from-km": "100", "--zenith": "0.2",
            "--free-calibration": None, "--as-recorded": None, "--quality": "standard",
            "--output": ["--output", "taken/inside"],
            "--set": "climate.ground.albedo=0.7",
        },
    ),
    "validate stars": (
        ["twilight.studies.camera.read_camera", "twilight.studies.camera.image.read_image",
         "twilight.studies.camera.response.load_response", "twilight.studies.validate.stars.calibrate.calibrate",
         "twilight.studies.camera.write_camera", "twilight.studies.validate.stars.picture.draw",
         "twilight.cli.validate_stars._dated", "twilight.cli.validate_stars._report"],
        ["a.jpg", "--camera", "guess.yaml"],
        {
            "--camera": "other.yaml", "--at": "2026-06-21T22:00Z", "--time-zone": "Europe/Berlin",
            "--latitude": [*PLACE, "--at", "2026-06-21T22:00Z"], "--longitude": PLACE[2:],
            "--altitude": "1", "--temperature": "-5", "--year": "2000", "--distortion": "1", "--threshold": "7",
            "--planets": None, "--picture": "p.png", "--output": "c.yaml",
        },
    ),
    "climate from": (
        ["twilight.config.measured.read"],
        ["--ozone", "climatology", "--at", "2026-06-21T12:00Z", *PLACE],
        {
            "--at": "2026-01-21T12:00Z", "--latitude": "5", "--longitude": "100", "--time-zone": "Europe/Berlin",
            "--base": "urban", "--ozone": "none", "--name": "mine", **SET,
        },
    ),
    "show": ([], ["pure-air"], {"--output": "p.png", "--set": "gases.ozone.column_du=100"}),
    "cache": ([], [], {"--clear": None}),
}  # fmt: skip

MEANT_FOR_OTHERS = {
    ("render", "--time-zone"): "takes the place of", ("light", "--time-zone"): "its time has an offset",
    ("climate from", "--time-zone"): "its time has an offset", ("climate from", "--longitude"): "ozone by latitude",
    ("validate stars", "--time-zone"): "its time has an offset",
}  # fmt: skip
"""Options that change nothing here, and why."""


def commands(group: Any, before: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*before, name))
        else:
            yield " ".join((*before, name)), command


OPTIONS = {
    name: {
        max(names, key=len)
        for one in command.params
        if one.param_type_name == "option"
        for names in (one.opts, one.secondary_opts)
        if names
    }
    - {"--help"}
    for name, command in commands(typer.main.get_command(app))
}


def test_no_option_is_left_out():
    """A new option, or a new command, must be tried here."""
    assert {name: set(tried) for name, (_, _, tried) in CASES.items()} == OPTIONS


def outcome(command: str, mocked: list[str], words: list[str]) -> str:
    """All that a command says, hands on and ends with."""
    asked = MagicMock(name="asked")
    cached = Path("cache/optics/a.f8")
    cached.parent.mkdir(parents=True, exist_ok=True)
    cached.write_bytes(bytes(8))
    with ExitStack() as stack:
        for i, name in enumerate(mocked):
            mock = getattr(asked, f"call{i}")
            mock.return_value.__iter__.side_effect = lambda: iter([asked.item])
            mock.return_value.drawn, mock.return_value.first.name = None, "name"  # of a sweep
            if name.endswith("on_own_day"):
                mock.return_value = asked.measured, [asked.basis], None
            stack.enter_context(patch(name, mock))
        done = CliRunner().invoke(app, [*command.split(), *words])
    said = [done.exit_code, done.stdout, done.stderr, repr(asked.mock_calls)]
    return re.sub(r"id='\d+'|0x[0-9a-f]+|\d+(\.\d+)? s\b", "", " ".join(map(str, said)))


def with_option(words: list[str], option: str, value: str | list[str] | None) -> list[str]:
    given = [option] if value is None else value if isinstance(value, list) else [option, value]
    if option in words:
        at = words.index(option)
        words = words[:at] + words[at + 2 :]
    return [*words, *given]


@pytest.mark.slow
@pytest.mark.parametrize("command", CASES)
def test_every_option_changes_something(command, tmp_path, monkeypatch):
    """An option that is accepted and dropped would do nothing without a word."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "taken").write_text("a file")
    mocked, words, tried = CASES[command]
    before = outcome(command, mocked, words)
    assert outcome(command, mocked, words) == before, "the same words, asked twice, differ"
    unchanged = {
        option
        for option, value in tried.items()
        if outcome(command, mocked, with_option(words, option, value)) == before
    }
    assert unchanged <= {option for name, option in MEANT_FOR_OTHERS if name == command}
