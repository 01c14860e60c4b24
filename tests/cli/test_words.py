"""Arguments as people type or paste them."""

import pytest
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.cli.words import as_meant, perhaps_a_decimal_comma


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["--sun-elevation", "−4"], ["--sun-elevation", "-4"]),
        (["--sun-elevation=−4,−5.5"], ["--sun-elevation=-4,-5.5"]),
        (["--set", "ground.altitude_km=−0.4"], ["--set", "ground.altitude_km=-0.4"]),
        (["--latitude", "52.5N", "--longitude", "13.4 E"], ["--latitude", "52.5", "--longitude", "13.4"]),
        (["--latitude", "33.9s", "--longitude=70.6°W"], ["--latitude", "-33.9", "--longitude=-70.6"]),
        (["--latitude", "52.5E"], ["--latitude", "52.5E"]),
        (["--latitude", "-33.9"], ["--latitude", "-33.9"]),
        (["render", "a−b.yaml", "--output", "−x", "12N"], ["render", "a−b.yaml", "--output", "−x", "12N"]),
    ],
)
def test_signs_and_hemispheres_are_read(typed, meant):
    """A pasted minus sign or 52.5N would be refused, or a file's name be changed."""
    assert as_meant(typed) == meant


def test_a_decimal_comma_is_told_from_a_list():
    """-4,5 would be two suns in silence."""
    assert perhaps_a_decimal_comma("-4,5") and not any(map(perhaps_a_decimal_comma, ("-4.5", "5,0,-6", "-4, -5", "4")))
    result = CliRunner().invoke(app, ["render", "pure-air", "--sun-elevation", "-4,5", "--plan"])
    assert result.exit_code == 0 and "suns at -4 and 5 deg; decimals have a point" in result.stderr


def test_words_that_the_shell_has_cut_are_told_to_need_quotes():
    """ "civil dusk" without quotes would be unexpected arguments and nothing else."""
    for command in (["times", "--latitude", "5", "--longitude", "5", "civil", "dusk"], ["fit", "perez", "a", "b", "c"]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2 and "need quotes, e.g. --at '2026-06-21 civil dusk'" in result.stderr
