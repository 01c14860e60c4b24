"""`twilight export`: the sky of a climate for other programs."""

from __future__ import annotations

import typer

from twilight.cli.export_prague import prague
from twilight.cli.export_shader import shader
from twilight.cli.terminal import with_errors_as_sentences

app = typer.Typer(name="export", help="Tables for other programs.", no_args_is_help=True)
for command in (shader, prague):
    app.command()(with_errors_as_sentences(command))
