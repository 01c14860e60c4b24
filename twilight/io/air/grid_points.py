"""Points of maps over time: which indices of a grid a place and a time lie between, and the values there."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.io.air.lines import spoken

MOST_STEPS_OUTSIDE = 0.51
"""A point may be so far outside a map, in its own steps: maps are of cells."""


def by_valid_time(data: Any) -> Any:
    """A forecast, which has a time that it starts from and a time since, by the time that it is for alone.

    Of several runs for one time the one that started last counts.
    """
    start = next((name for name in ("forecast_reference_time", "time") if name in data.dims), None)
    since = next((name for name in ("forecast_period", "step") if name in data.dims), None)
    if since is None:
        return data
    if "valid_time" not in data.variables and (since not in data.variables or start is None):
        return data
    valid = data["valid_time"] if "valid_time" in data.variables else data[start] + data[since]
    dims = [str(dim) for dim in valid.dims]
    stamps = valid.values.ravel()
    runs = np.broadcast_to(data[start].values[:, None] if start else 0, (data.sizes.get(start, 1), data.sizes[since]))
    runs = (runs.T if start is not None and dims[0] == since and len(dims) > 1 else runs).ravel()
    last = np.lexsort((runs, stamps)) if stamps.size == runs.size else np.arange(stamps.size)
    keep = [int(i) for n, i in enumerate(last) if n + 1 == last.size or stamps[last[n + 1]] != stamps[i]]
    rest = data.drop_vars([name for name in ("valid_time", *dims) if name in data.variables])
    stacked = rest.stack(_valid=dims, create_index=False).isel(_valid=keep)
    return stacked.assign_coords(valid_time=("_valid", stamps[keep]))


def dimension(data: Any, name: str) -> str:
    """The dimension of a coordinate; its own name where it has none."""
    return str(data[name].dims[0]) if data[name].dims else name


def weighted(variable: Any, weights: list[tuple[str, list[tuple[int, float]]]]) -> Any:
    """A variable with its dimensions of place and time taken at weighted indices."""
    used = [(dim, [pair for pair in pairs if pair[1] > 0.0]) for dim, pairs in weights if dim in variable.dims]
    for dim, pairs in used:
        variable = variable.isel({dim: [index for index, _ in pairs]})
    variable = _merged(variable.load())
    for dim, pairs in used:
        variable = sum(variable.isel({dim: i}) * weight for i, (_, weight) in enumerate(pairs))
    return variable


def _merged(value: Any) -> Any:
    """Of versions of one field (ERA5's expver: final, and preliminary for the last months) the first that has a number
    at each time and level."""
    if "expver" not in value.dims:
        return value
    order = np.argsort(value["expver"].values.astype(str)) if "expver" in value.coords else range(value.sizes["expver"])
    versions = [value.isel(expver=int(i), drop=True) for i in order]
    merged = versions[0]
    for version in versions[1:]:
        merged = merged.where(np.isfinite(merged), version)
    return merged


def between(
    path: Path, name: str, nodes: np.ndarray, at: float, unit: str, turn: float = 0.0
) -> list[tuple[int, float]]:
    """Indices and weights of the nodes on both sides of a value; the single one, or the end half a step away."""
    if nodes.size == 1:
        return [(0, 1.0)]
    order = np.argsort(nodes)
    x = nodes[order]
    if turn:  # a map that goes round the globe, from any meridian
        at = x[0] + (at - x[0]) % turn
        if at > x[-1]:
            gap = x[0] + turn - x[-1]
            step = float(np.max(np.diff(x)))
            if gap <= 1.5 * step:
                f = (at - x[-1]) / gap
                return [(int(order[-1]), 1.0 - f), (int(order[0]), f)]
            if at - turn >= x[0] - MOST_STEPS_OUTSIDE * step:
                at -= turn
    slack = MOST_STEPS_OUTSIDE * float(np.max(np.diff(x)))
    if not x[0] - slack <= at <= x[-1] + slack:
        if unit == "s":
            low, high, asked_for = (spoken(datetime.fromtimestamp(v, UTC)) for v in (x[0], x[-1], at))
            raise TwilightError(f"{path}: {name} goes from {low} to {high}, and {asked_for} is asked for")
        raise TwilightError(f"{path}: {name} goes from {x[0]:g} to {x[-1]:g} {unit}, and {at:g} is asked for")
    at = float(np.clip(at, x[0], x[-1]))
    i = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2))
    f = (at - x[i]) / (x[i + 1] - x[i])
    return [(int(order[i]), 1.0 - f), (int(order[i + 1]), f)]
