"""What `--plan` says of other qualities: error beside time and memory."""

import math
from collections.abc import Iterable
from typing import Any

from twilight.cli.terminal import print_table, time_of


def print_choices(scenes: Iterable[tuple[str, Any]]) -> None:
    """Print for each scene its solver's qualities and the fitted model; what is taken has a star."""
    from twilight.engine.choices import choices  # start-up

    rows, reasons = [], []
    for name, scene in scenes:
        for choice in choices(scene):
            label = f"{choice.solver} {choice.quality}{' *' if choice.chosen else ''}"
            if choice.cost is None:
                reasons.append(f"{name}: {label} does not serve: {choice.reason}")
                continue
            time = "-" if choice.cost.cpu_s is None else time_of(choice.cost.cpu_s)
            memory = "-" if choice.cost.total_bytes is None else f"{choice.cost.total_bytes / 1e9:.2g}"
            rows.append([name, label, _percent(choice.error), time, memory])
    columns = ["scene", "by", "error of 95 % of directions", "processor time, about", "memory in all [GB]"]
    print_table(columns, rows, right=(2, 3, 4))
    for reason in reasons:
        print(reason)


def _percent(error: float | None) -> str:
    if error is None:
        return "not known"
    return f"{100.0 * error:.2g} %" if math.isfinite(error) else "not measured"
