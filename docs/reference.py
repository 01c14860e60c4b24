"""The page of the command line, made from the program's own commands when the site is built."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def write_command_line(path: Path) -> None:
    """Write a section for each command: what it does, its arguments and options with their help."""
    import typer

    from twilight.cli.app import app

    parts = ["# Command line", "", "Made from the program. Every command takes `--help`.", ""]
    parts += _commands(typer.main.get_command(app), "twilight")
    text = "\n".join(parts) + "\n"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _commands(command: Any, name: str) -> list[str]:
    if hasattr(command, "commands"):
        children = sorted(command.commands.items())
        return [line for child, below in children for line in _commands(below, f"{name} {child}")]
    rows = []
    for parameter in command.params:
        help_text = (getattr(parameter, "help", None) or "").replace("|", "\\|").replace("\n", " ")
        if parameter.param_type_name == "argument":
            rows.append(((parameter.metavar or parameter.name).upper(), help_text))
        elif "--help" not in parameter.opts:
            metavar = "" if parameter.is_flag else f" {parameter.metavar or parameter.type.name.upper()}"
            rows.append((", ".join(parameter.opts) + metavar, help_text))
    table = [f"| `{word.replace('|', chr(92) + '|')}` | {text} |" for word, text in rows]
    head = ["| | |", "|---|---|"] if table else []
    return [f"## {name}", "", (command.help or "").strip(), "", *head, *table, ""]
