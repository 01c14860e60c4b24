"""The command line: parses, calls, prints."""

from __future__ import annotations

import typer

from twilight.cli import (
    animate,
    cache,
    climate,
    compare,
    export,
    fit,
    light,
    render,
    show,
    sweep,
    timeline,
    times,
    validate,
    view,
)
from twilight.cli.terminal import with_errors_as_sentences

app = typer.Typer(
    name="twilight",
    help="Spectral radiance of the whole clear sky, from full day to the last light of astronomical twilight.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
commands = (
    render.render,
    view.view,
    animate.animate,
    sweep.sweep,
    compare.compare,
    times.times,
    timeline.timeline,
    light.light,
    show.climates,
    show.configs,
    show.describe,
    show.solvers,
    show.schema,
    cache.cache,
)
for command in commands:
    app.command()(with_errors_as_sentences(command))
app.add_typer(climate.app)
app.add_typer(export.app)
app.add_typer(fit.app)
app.add_typer(validate.app)


@app.callback(invoke_without_command=True)
def _version(version: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    if version:
        from twilight import __version__

        typer.echo(f"twilight {__version__}")
        raise typer.Exit
