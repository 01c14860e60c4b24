"""Pages that are run when the site is built: what they show is what the program says, and one that fails breaks it.

In the pages of `PAGES` every `yaml` block that has a name is written to NAME.yaml, every line `twilight ...` of a
`sh` block is run, and all `python` blocks are run in one process; blocks marked `no-run` are left out.  All of a page
runs in one empty folder, in the order of the page.  What is printed stands below its block.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

PAGES = ("first-sky", "jobs/observatory", "jobs/data-set", "jobs/two-codes")
FENCE = re.compile(r"^```(sh|yaml|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARK = "--- end of block ---"
LONGEST_S = 600


class PageError(Exception):
    """A block of a page failed."""


def run_page(text: str) -> str:
    """The page with what its blocks print.  Errors: PageError with the block and what it said."""
    with tempfile.TemporaryDirectory() as folder:
        parts, end = [], 0
        pieces = [found[2] for found in FENCE.finditer(text) if found[1] == "python"]
        printed: list[str] | None = None
        for found in FENCE.finditer(text):
            language, code = found[1], found[2]
            said = ""
            if language == "yaml":
                name = re.search(r"^name: *(\S+)", code, re.MULTILINE)
                if name:
                    (Path(folder) / f"{name[1]}.yaml").write_text(code, encoding="utf-8")
            elif language == "sh":
                said = "".join(
                    _run([sys.executable, "-m", *shlex.split(line)], folder)
                    for line in code.splitlines()
                    if line.startswith("twilight ")
                )
            else:
                # all at once where the first of them stands: one process keeps their names
                printed = _python(pieces, folder) if printed is None else printed
                said = printed.pop(0)
            parts.append(text[end : found.end()])
            if said.strip():
                parts.append(f"\n\n```text\n{said.strip()}\n```")
            end = found.end()
        return "".join([*parts, text[end:]])


def _python(pieces: list[str], folder: str) -> list[str]:
    code = "\n".join(f"{piece}\nprint({MARK!r})" for piece in pieces)
    return _run([sys.executable, "-c", code], folder).split(MARK + "\n")


def _run(words: list[str], folder: str) -> str:
    root = Path(__file__).resolve().parents[1]
    paths = os.pathsep.join(filter(None, [str(root), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=LONGEST_S, env={**os.environ, "PYTHONPATH": paths}
    )
    if done.returncode:
        raise PageError(f"{shlex.join(words[1:])}\n{done.stdout}{done.stderr}")
    return done.stdout.replace(folder, ".")
