"""The command line: parses, calls, prints."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

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
from twilight.cli.words import QUOTES

PANELS: dict[str, tuple[Callable[..., None] | typer.Typer, ...]] = {
    "Skies and light": (
        render.render,
        view.view,
        animate.animate,
        sweep.sweep,
        timeline.timeline,
        light.light,
        times.times,
    ),
    "Models, measurements, other programs": (
        compare.compare,
        fit.app,
        export.app,
        validate.app,
    ),
    "What there is": (climate.app, show.show, cache.cache),
}
"""The commands by the heading under which `--help` lists them, in this order."""


class PanelledHelp(TyperGroup):
    """Help that lists the commands by `PANELS`."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; an error of words that are too many says that words need quotes."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            if "unexpected extra argument" in str(getattr(error, "message", "")):
                error.message += QUOTES  # type: ignore[attr-defined]
            raise

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands."""
        limit = formatter.width - 6 - max(map(len, self.commands))
        for panel in PANELS:
            rows = [
                (name, self.commands[name].get_short_help_str(limit))
                for name, where in panel_of.items()
                if where == panel
            ]
            with formatter.section(panel):
                formatter.write_dl(rows)


app = typer.Typer(
    name="twilight",
    cls=PanelledHelp,
    help="Spectral radiance of the whole clear sky, from full day to the last light of astronomical twilight.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
panel_of: dict[str, str] = {}
"""The heading of each command, by its name."""
for panel, commands in PANELS.items():
    for command in commands:
        if isinstance(command, typer.Typer):
            app.add_typer(command, rich_help_panel=panel)
            panel_of[str(command.info.name)] = panel
        else:
            app.command(rich_help_panel=panel)(with_errors_as_sentences(command))
            panel_of[command.__name__] = panel


@app.callback(invoke_without_command=True)
def _version(version: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    if version:
        from twilight import __version__

        typer.echo(f"twilight {__version__}")
        raise typer.Exit
