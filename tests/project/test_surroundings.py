"""What is around the program is missing, full or gone: one sentence, no traceback, no half files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = [sys.executable, "-c", "from twilight.cli import main; main()"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
CHEAP = ["render", "pure-air", "--solver", "preetham", "--sun-elevation", "20", "--set", "texture.resolution_deg=15"]

pytestmark = pytest.mark.skipif(os.name == "nt", reason="files and shells of POSIX")


def shell(words: str, arguments=(), cwd=None, **environment):
    """Run `words` in a shell with the program as "$@"."""
    return subprocess.run(
        ["bash", "-c", words, "bash", *PROGRAM, *arguments],
        capture_output=True,
        cwd=cwd,
        env={**ENVIRONMENT, **environment},
        timeout=120,
    )


def assert_sentence(result, *parts: str) -> None:
    text = result.stderr.decode()
    last = text.strip().splitlines()[-1]
    assert result.returncode == 2, text
    assert last.startswith("twilight: ") and "Traceback" not in text and "Exception ignored" not in text, text
    assert all(part in last for part in parts), last


def test_a_closed_output_is_one_sentence():
    """Output into nothing would be a traceback."""
    assert_sentence(shell('"$@" >&-', ["show", "schema", "climate"]), "standard output is closed")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("arguments", [["show", "schema", "climate"], ["--version"]])
def test_a_full_device_is_one_sentence(arguments):
    """Output onto a full disk would be a traceback."""
    assert_sentence(shell('"$@" > /dev/full', arguments), "No space left on device")


def test_a_reader_that_leaves_is_no_traceback():
    """`| head` would print a traceback."""
    result = shell('"$@" | true; exit ${PIPESTATUS[0]}', ["show", "schema", "climate"])
    assert result.returncode in (0, 1) and not result.stderr, result.stderr


def test_nothing_is_said_where_errors_go_nowhere():
    """A closed stderr would end in another exit code."""
    assert shell('"$@" 2>&-', ["render", "nowhere"]).returncode == 2
    assert shell('"$@" 2>&-', ["--version"]).stdout.startswith(b"twilight ")


def test_a_working_directory_that_is_gone_is_one_sentence(tmp_path):
    """A folder that was deleted would be a traceback."""
    result = shell(f'mkdir {tmp_path}/gone && cd {tmp_path}/gone && rmdir ../gone && "$@"', CHEAP)
    assert_sentence(result, "the working directory is gone")


def test_a_name_that_is_not_text_is_one_sentence_and_leaves_nothing(tmp_path):
    """A name in another encoding would be a traceback."""
    result = shell('"$@"', [*CHEAP, "--output", os.fsencode(tmp_path) + b"/sky\xff"])
    assert_sentence(result, "sky\\udcff", "encoding (utf-8)")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    result = shell('"$@"', [*CHEAP, "--output", f"{tmp_path}/ciel-d'été"], **plain)
    assert_sentence(result, "this name cannot be written", "LC_ALL=C.UTF-8")
    assert list(tmp_path.iterdir()) == []


def test_a_letter_that_the_locale_lacks_is_printed_otherwise(tmp_path):
    """A letter would end the program in the C locale."""
    climate = tmp_path / "c.yaml"
    climate.write_text("version: 1\nname: c\ndescription: ciel d'été\naerosol: null\n", encoding="utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    result = shell('"$@"', ["show", str(climate), "--output", str(tmp_path / "p.png")], **plain)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[0] == b"c: ciel d'\\xe9t\\xe9"
