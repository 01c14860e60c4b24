"""The command line: bad input is one sentence, and an interrupt leaves nothing half done."""

import os
import re
import signal
import subprocess
import sys

import pytest
from rendering import call
from typer.testing import CliRunner

from twilight.cli.app import app


def test_an_output_that_cannot_be_written_is_refused_before_anything_is_computed(plain, table, tmp_path):
    """Hours would be computed for a folder that cannot be written."""
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "sub"):
        result = call("render", table, "--output", folder)
        assert result.exit_code == 2 and str(folder) in result.stderr and "not a folder" in result.stderr
    for name in ("file/profile.png", "profile.svg"):
        result = call("show", table, "--output", tmp_path / name)
        assert result.exit_code == 2 and len(result.stderr.strip().splitlines()) == 1
    for command, name in (("show", "a.png"), ("fit perez", "a.yaml")):
        (tmp_path / name).mkdir()
        result = call(
            *command.split(), table if command == "show" else "continental-average", "--output", tmp_path / name
        )
        assert result.exit_code == 2 and result.stderr.strip().endswith(f"{name}: is a folder, not a file"), command
        (tmp_path / name).rmdir()
    assert not plain.calls
    assert {p.name for p in tmp_path.iterdir()} == {"file", "t1.csv", "T1.yaml"}


def test_a_sky_larger_than_the_memory_is_refused(plain, tmp_path):
    """The machine would swap, or the system end the program."""
    huge = ["--set", "texture={azimuth_count: 7200, elevation_count: 1800}", "--set", "wavelengths.count=2000"]
    result = CliRunner().invoke(app, ["render", "pure-air", *huge, "--output", str(tmp_path / "sky")])
    assert result.exit_code == 2, result.output
    assert "2000 wavelengths" in result.stderr and "GB" in result.stderr and "texture.resolution_deg" in result.stderr
    assert not plain.calls and not (tmp_path / "sky").exists()


def test_an_interrupt_during_imports_gives_no_traceback(tmp_path):
    """Ctrl-C in the first half second would print a traceback."""
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n")
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from twilight.cli import main; main()"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 130 and result.stderr == "twilight: interrupted\n"


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(("number", "code", "where"), [(signal.SIGINT, 130, "main"), (signal.SIGTERM, 143, "pool")])
def test_signals_end_a_command_inside_a_kernel(tmp_path, number, code, where):
    """Compiled code that would run for a month, in the main thread or in slices: the command ends, no file is left."""
    program = (
        "import os, signal, sys, threading\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import numba, typer\n"
        "from twilight.base.threads import in_slices\n"
        "from twilight.base.whole_files import whole_file\n"
        "from twilight.cli.terminal import with_errors_as_sentences\n"
        "from twilight.cli import app, main\n"
        "from twilight.jit.kernels import njit\n"
        "@njit()\n"
        "def long(n, start):\n"
        "    x = start\n"
        "    for i in range(n):\n"
        "        x = x * 1.0000001 + 1.0 / (x + i)\n"
        "    return x\n"
        "def command():\n"
        "    long(10, 1.0)\n"
        f"    threading.Timer(0.3, os.kill, (os.getpid(), {int(number)})).start()\n"
        "    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))\n"
        "    with whole_file('table.csv') as temporary:\n"
        "        temporary.write_text('half')\n"
        f"        if {where!r} == 'main':\n"
        "            long(10**16, 1.0)\n"
        "        in_slices(lambda i, j: long(10**16, 1.0), 8)\n"
        "app.app = typer.Typer()\n"
        "app.app.command()(with_errors_as_sentences(command))\n"
        "main()\n"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr and result.stderr.startswith("twilight: ")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_names_commands_that_there_are():
    """A refusal would send its reader to a command that is gone."""
    said = CliRunner().invoke(app, ["render", "nosuch.yaml"])
    assert said.exit_code == 2
    named = re.findall(r"`twilight ([^`]+)`", said.stderr.replace("\n", " "))
    assert named and all(CliRunner().invoke(app, words.split()).exit_code == 0 for words in named), said.stderr
