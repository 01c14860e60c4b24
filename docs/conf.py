"""The documentation of the installed package as a site: `pip install '.[docs]'`, `sphinx-build -W docs build/docs`."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import twilight  # noqa: E402

project = "twilight"
release = twilight.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_preprocess_types = True
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"twilight {release}"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
exclude_patterns: list[str] = []
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
suppress_warnings = ["myst.header"]


def keep_lists(app, what, name, obj, options, lines):
    """Lists that are written as `name: meaning`, with what follows indented, stay lines: elsewhere they are errors."""
    paragraphs: list[list[str]] = [[]]
    for line in lines:
        paragraphs.append([]) if not line.strip() else paragraphs[-1].append(line)
    out = []
    for paragraph in paragraphs:
        if paragraph and not paragraph[0].startswith((" ", ":", "..", "*", "-", ">>>")):
            if any(line.startswith("  ") for line in paragraph):
                paragraph = [f"| {line}" if not line.startswith("  ") else f"  {line.strip()}" for line in paragraph]
        out += [*paragraph, ""]
    lines[:] = out


def to_the_repository(app, docname, source):
    """Links to files that are no pages of the site."""
    source[0] = source[0].replace("(../README.md)", "(index.md)")


def run_what_it_shows(app, docname, source):
    """Pages that show the program at work are run."""
    from executed import PAGES, PageError, run_page
    from sphinx.errors import ExtensionError

    if docname in PAGES:
        try:
            source[0] = run_page(source[0])
        except PageError as error:
            raise ExtensionError(f"docs/{docname}.md: a block failed: {error}") from None


def setup(app):
    from reference import write_command_line

    write_command_line(HERE / "command-line.md")
    app.connect("autodoc-process-docstring", keep_lists)
    app.connect("source-read", to_the_repository)
    app.connect("source-read", run_what_it_shows)
