"""README and docs show what works: they are run in an installed program, and what they name is there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
MADE = "command-line.md"
"""The page that the build of the site writes."""
PAGES = [ROOT / "README.md", *(page for page in sorted(DOCS.rglob("*.md")) if page.name != MADE)]
OTHERS = ("CONTRIBUTING.md", "benchmarks/README.md")
TEXTS = [*PAGES, *(ROOT / name for name in OTHERS)]


@pytest.fixture
def executed(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    import executed

    return executed


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A function that runs Python outside the tree, with the package as a wheel of `pyproject.toml` holds it."""
    site, folder = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("elsewhere")
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    for source, target in {**{name: name for name in wheel["packages"]}, **wheel["force-include"]}.items():
        shutil.copytree(ROOT / source, site / target, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {
        **os.environ,
        "PYTHONPATH": str(site),
        "TWILIGHT_CACHE_DIR": str(folder / "cache"),
        "MPLBACKEND": "agg",
    }

    def run(*words: object) -> subprocess.CompletedProcess:
        command = [sys.executable, *map(str, words)]
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)

    where = run("-c", "import twilight; print(twilight.__file__)")
    assert where.stdout.startswith(str(site)), where.stderr
    return run


@pytest.mark.parametrize(
    "block", ["```python\nimport nothing_of_this_name\n```\n", "```sh\ntwilight render no-such-climate\n```\n"]
)
def test_a_page_that_fails_is_an_error(executed, block, tmp_path, monkeypatch):
    """The check of the docs would pass pages that do not run."""
    with pytest.raises(executed.PageError, match=r"nothing_of_this_name|no-such-climate"):
        executed.run_page(f"# Page\n\n{block}")
    monkeypatch.chdir(tmp_path)
    [failed] = executed.check(f"# Page\n\n{block}", plan=False)
    assert re.search(r"nothing_of_this_name|no-such-climate", failed)


def test_every_command_shown_is_understood_outside_the_tree(installed, tmp_path):
    """A command that works in the source folder alone, a key or an option that is gone."""
    done = installed(DOCS / "executed.py", "--plan", tmp_path / "pages", *PAGES)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        page.relative_to(ROOT).as_posix()
        for page in PAGES
        if re.search(r"^```(sh|python)\n", page.read_text("utf-8"), re.M)
    ],
)
def test_all_that_a_page_shows_runs_outside_the_tree(installed, page, tmp_path):
    """Every command and piece of Python to its end, with coarse fields."""
    done = installed(DOCS / "executed.py", "--coarse", tmp_path / "pages", ROOT / page)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_that_a_page_names_are_there(page):
    """A file that was renamed or removed, a table that was never kept."""
    text = page.read_text(encoding="utf-8")
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    for link in links:
        if link and "://" not in link and link != MADE:
            assert (page.parent / link).exists(), link
    for name in re.findall(r"`(?:python )?((?:twilight|tests|benchmarks|docs|climates|configs)/[\w*./-]+)", text):
        assert list(ROOT.glob(name)), name
    for name in re.findall(r"`(twilight(?:\.\w+)+)", text):
        parts = name.split(".")
        assert any((ROOT / Path(*parts[:n])).with_suffix(".py").exists() for n in (len(parts), len(parts) - 1)) or any(
            (ROOT / Path(*parts[:n]) / "__init__.py").exists() for n in (len(parts), len(parts) - 1)
        ), name


def test_every_page_is_in_the_table_of_contents():
    """A page could be reached from nowhere."""
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = {
        line.strip() for block in re.findall(r"```\{toctree\}(.*?)```", index, re.DOTALL) for line in block.splitlines()
    }
    for page in PAGES[1:]:
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert name in listed | {"index"}, name


def test_figures_of_pages_are_those_of_their_tables(monkeypatch):
    """A table was renewed and the page was not: `python benchmarks/pages.py`."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import pages

    for name in pages.PARTS:
        assert pages.filled(name) == (ROOT / name).read_text(encoding="utf-8"), name
