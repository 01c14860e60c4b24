"""Pages that are run: what they show is what the program does.

    python docs/executed.py --coarse FOLDER PAGE...  run all that the pages show, below FOLDER, with coarse fields
    python docs/executed.py --plan FOLDER PAGE...    have every command read, and compute as little as may be

Of a page every `yaml` block that has a name is written to NAME.yaml; every line `twilight ...` of a `sh` block is run;
and all `python` blocks are run in one process.  All of a page runs in one folder, in the order of the page.  Indented
commands and blocks of `sh no-run` are read alone; other blocks marked `no-run` are left out.  For the site (`run_page`)
what is printed stands below its block.
"""

from __future__ import annotations

import contextlib
import functools
import io
import re
import shlex
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any
from unittest import mock

PAGES = ("first-sky", "sweeps", "two-codes")
"""Pages whose blocks are run when the site is built, and shown with what they print."""
FENCE = re.compile(r"^```(sh|yaml|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"^```sh no-run\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^    (twilight .*(?:\\\n.*)*)$", re.MULTILINE)
MARK = "--- end of block ---"
LONGEST_S = 600
PLANNED = ("render", "sweep")
"""Commands that `--plan` runs with their own `--plan`; `HELPED` it runs with `--help`, all others as they are."""
HELPED = (
    "show", "climate", "compare", "fit", "export", "view", "animate", "validate", "light", "timeline",
)  # fmt: skip


class PageError(Exception):
    """A block of a page failed."""


def blocks(text: str) -> list[tuple[str, str]]:
    """(language, code) of every block of a page, in its order; "read" for commands that are shown but not run."""
    fenced = [(block.start(), block[1], block[2]) for block in FENCE.finditer(text)]
    not_run = [(block.start(), "read", block[1]) for block in NOT_RUN.finditer(text)]
    rest = re.sub(r"^```.*?^```$", lambda block: " " * len(block[0]), text, flags=re.MULTILINE | re.DOTALL)
    indented = [(block.start(), "read", block[1]) for block in INDENTED.finditer(rest)]
    return [block[1:] for block in sorted([*fenced, *not_run, *indented])]


def commands(code: str) -> list[str]:
    """Every command of the program in a block, each as one line."""
    lines = [line.strip() for line in code.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith("twilight ")]


def run_page(text: str) -> str:
    """The page with what its blocks print.  Errors: PageError with the block and what it said."""
    with tempfile.TemporaryDirectory() as folder:
        parts, end = [], 0
        pieces = [block[2] for block in FENCE.finditer(text) if block[1] == "python"]
        printed: list[str] | None = None
        for block in FENCE.finditer(text):
            language, code = block[1], block[2]
            output = ""
            if language == "yaml":
                _write(code, Path(folder))
            elif language == "sh":
                lines = commands(code)
                output = "".join(_run([sys.executable, "-m", *shlex.split(line)], folder) for line in lines)
            else:
                # all at once where the first of them stands: one process keeps their names
                printed = _python(pieces, folder) if printed is None else printed
                output = printed.pop(0)
            parts.append(text[end : block.end()])
            if output.strip():
                parts.append(f"\n\n```text\n{output.strip()}\n```")
            end = block.end()
        return "".join([*parts, text[end:]])


def _write(code: str, folder: Path) -> None:
    name = re.search(r"^name: *(\S+)", code, re.MULTILINE)
    if name:
        (folder / f"{name[1]}.yaml").write_text(code, encoding="utf-8")


def _python(pieces: list[str], folder: str) -> list[str]:
    code = "\n".join(f"{piece}\nprint({MARK!r})" for piece in pieces)
    return _run([sys.executable, "-c", code], folder).split(MARK + "\n")


def _run(words: list[str], folder: str) -> str:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=LONGEST_S)
    if done.returncode:
        raise PageError(f"{shlex.join(words[1:])}\n{done.stdout}{done.stderr}")
    return done.stdout.replace(folder, ".")


def check(text: str, plan: bool) -> list[str]:
    """Run all that a page shows in this process and in the working directory; what failed, a line or more for each."""
    failed = []
    names: dict = {"__name__": "__main__"}
    for language, code in blocks(text):
        if language == "yaml":
            _write(code, Path())
        elif language == "sh" or (language == "read" and plan):
            for line in commands(code):
                if re.search(r" (configs|climates)/", line):
                    failed.append(f"{line}: works in the source folder alone")
                words = shlex.split(line)[1:]
                more = "--plan" if words[0] in PLANNED else "--help" if words[0] in HELPED else ""
                if not plan or not more or more in words:
                    failed += _call(line, words)
                    continue
                # errors and costs of all qualities take ten times as long as the rest of a plan
                with mock.patch("twilight.cli.choices.print_choices"):
                    failed += _call(line, [*words, more])
        elif language == "python" and not plan:
            try:
                exec(compile(code, "block", "exec"), names)
            except Exception:
                failed.append(f"{code}{traceback.format_exc(limit=-1)}")
    return failed


def _call(line: str, words: list[str]) -> list[str]:
    from typer.testing import CliRunner

    from twilight.cli.app import app

    result = CliRunner().invoke(app, words)
    return [] if result.exit_code == 0 else [f"{line}\n{result.output[-2000:]}{result.exception or ''}"]


def _coarsen() -> None:
    """Fields of `zones` at `draft` and `standard` that are solved in a second or less."""
    from dataclasses import replace

    from twilight.solvers import zones

    draft: Any = zones.QUALITIES["draft"]
    coarse = replace(draft, altitude_density=0.35, zenith_density=0.4, polar_directions=4, beam_density=0.4)
    qualities: Any = zones.QUALITIES
    qualities.update(draft=coarse, standard=coarse)


def main(words: list[str]) -> int:
    """Check pages, each in a folder of its own; 1 where one failed."""
    import typer.testing

    # or all commands with their options are built anew for every call
    typer.testing._get_command = functools.cache(typer.testing._get_command)  # type: ignore[assignment]
    way, folder, *pages = words
    if way == "--coarse":
        _coarsen()
    failed = []
    for number, page in enumerate(pages):
        text = Path(page).read_text(encoding="utf-8")
        workplace = Path(folder) / f"{number}-{Path(page).stem}"
        workplace.mkdir(parents=True)
        with contextlib.chdir(workplace), contextlib.redirect_stdout(io.StringIO()):
            failed += [f"{page}: {what}" for what in check(text, plan=way == "--plan")]
    print("\n".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
