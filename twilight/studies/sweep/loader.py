"""Drawn skies one after another, as models are fitted to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from twilight.base.errors import TwilightError, check_known
from twilight.studies.sweep.store import COMPUTED, PARTS
from twilight.studies.sweep.work import RADIANCE

if TYPE_CHECKING:
    from xarray import Dataset

NO_INPUTS = ("status", "split", "solar_bending", "sun_elevation_deg")
"""Variables over draws and suns that are no inputs; the last is `solar_elevation_angle`, too."""


def load_skies(path: str | Path, part: Literal["train", "validation", "all"] = "train") -> Dataset:
    """The skies that are there of one part of a sweep with draws; radiance is read from the file when it is asked for.

    Parameters
    ----------
    path
        Folder that `twilight sweep` wrote.
    part
        `train`, `validation` or `all`: no draw is in both parts.

    Returns
    -------
    xarray.Dataset
        The variables of the sweep, along `sky` in place of its own dimensions, and `inputs` (sky, input), float32:
        what each number is stands in the coordinate `input`: keys of the draw, the sun's and the observer's
        coordinates and the turbidity.  A text counts as its index among the sorted texts of all skies.

    Raises
    ------
    TwilightError
        For a folder that is no sweep, or one without draws.
    """
    import xarray  # optional

    check_known("part", part, ("all", *PARTS))
    try:
        data = xarray.open_zarr(path, decode_times=False)
    except (OSError, ValueError) as error:
        raise TwilightError(f"{path}: is not the dataset of a sweep ({error})") from None
    if "split" not in data or RADIANCE not in data:
        raise TwilightError(f"{path}: is no sweep with draws, as `twilight sweep` makes of a configuration with draws")
    dims = data["status"].dims
    there = (data["status"] == COMPUTED) & (part == "all" or data["split"] == PARTS.get(part))
    place = dict(zip(dims, np.nonzero(there.transpose(*dims).values), strict=True))
    skies = data.isel({d: xarray.DataArray(i, dims="sky") for d, i in place.items()})
    columns = {}
    for name in sorted(map(str, data.variables)):
        if data[name].dims and {*data[name].dims} <= {*dims} and name not in NO_INPUTS:
            column = skies[name].values
            if column.dtype.kind not in "biuf":
                column = np.searchsorted(np.unique(data[name].values.astype(object)), column.astype(object))
            columns[name] = column.astype(np.float32)
    inputs = xarray.DataArray(np.stack([*columns.values()], axis=-1), {"input": [*columns]}, ("sky", "input"))
    return skies.assign(inputs=inputs, draw=("sky", place["draw"]))
