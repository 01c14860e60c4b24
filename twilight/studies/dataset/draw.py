"""Which airs and suns a training set has, and which airs are held back for validation."""

from __future__ import annotations

import json
import random
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.config.document import read_yaml
from twilight.config.library import find
from twilight.config.load import Series, load_axes
from twilight.config.vary import LATIN_HYPERCUBE
from twilight.io.provenance import to_json

AIRS: dict[str, Any] = {
    "aerosol.optical_depth_550nm": {"from": 0.02, "to": 1.0, "scale": "log"},
    "aerosol.relative_humidity_percent": [0, 50, 70, 80, 90, 95],
    "gases.ozone.column_du": {"from": 200, "to": 450},
    "ground.albedo": {"from": 0.0, "to": 0.8},
}
"""What is drawn where the configuration says nothing: ranges of clear air; humidities are OPAC's classes."""
SUNS: dict[str, Any] = {"from": 60.0, "to": -18.0, "count": 40}
"""Elevations of the sun of every air where the configuration says nothing [deg]."""
AIR = "sample"
"""Name of the dimension of the airs."""
SPLIT = "split"
"""Name of the array in the dataset that says the part of each air, and of the attribute that says how it was drawn."""
TRAIN = 0
"""Value in `SPLIT` of an air that is trained with."""
VALIDATION = 1
"""Value in `SPLIT` of an air that is held back."""
PARTS = {"train": TRAIN, "validation": VALIDATION}
"""Values in `SPLIT` by the names that users give."""


def training_series(target: str, airs: int, seed: int, settings: Mapping[str, Any], names: Mapping[str, str]) -> Series:
    """A configuration, or a climate, with `airs` airs drawn and, unless it lists suns of its own, `SUNS`.

    Ranges are those of the configuration's vary.latin_hypercube, else `AIRS`.
    Errors: TwilightError as `load_axes`, and for a vary section whose airs are not drawn.
    """
    written = read_yaml(find(target)).get("vary") or {}
    if not isinstance(written, Mapping):
        load_axes(target, settings, names)  # says what is wrong
        raise TwilightError(f"{target}: vary is no section")
    drawn = written.get(LATIN_HYPERCUBE, {"ranges": AIRS})
    for key in written:
        if key.split(".")[0] not in (LATIN_HYPERCUBE, "sun", "observer"):
            raise TwilightError(
                f"{target}: vary.{key}: airs of a training set are drawn; put this key into "
                f"vary.{LATIN_HYPERCUBE}.ranges"
            )
    if not isinstance(drawn, Mapping):
        drawn = {"ranges": drawn}
    vary: dict[str, Any] = {**written, LATIN_HYPERCUBE: {**drawn, "samples": airs, "seed": seed}}
    if not any(str(key).split(".")[0] == "sun" for key in (*written, *settings)):
        vary["sun.elevation_deg"] = SUNS
    return load_axes(target, {**settings, "vary": vary}, names)


def split_of(airs: int, fraction: float, seed: int) -> np.ndarray:
    """`TRAIN` or `VALIDATION` of each air, (airs,): the nearest whole number of them, at least one, is drawn."""
    held = min(max(1, round(fraction * airs)), airs - 1)
    stream = random.Random(f"{seed}/{SPLIT}")  # whose random() is promised to stay the same
    order = np.argsort([stream.random() for _ in range(airs)])
    split = np.full(airs, TRAIN, np.int8)
    split[order[:held]] = VALIDATION
    return split


def write_split(path: Path, split: np.ndarray, facts: Mapping[str, Any]) -> None:
    """Put the variable `split` and what it was drawn with into the dataset at `path`, unless it is there.

    Errors: TwilightError where another split is there.
    """
    import zarr  # start-up

    group = zarr.open_group(path, mode="r+", use_consolidated=False)
    if SPLIT in group:
        if json.loads(str(group.attrs[SPLIT])) != dict(facts):
            raise TwilightError(f"{path}: is split with {group.attrs[SPLIT]}; give the same, or another --output")
        return
    about: dict[str, Any] = {"long_name": "part of the training set", "flag_values": [TRAIN, VALIDATION]}
    array = group.create_array(
        SPLIT,
        shape=split.shape,
        chunks=split.shape,
        dtype=split.dtype,
        fill_value=None,
        attributes={"_ARRAY_DIMENSIONS": [AIR], **about, "flag_meanings": " ".join(PARTS)},
    )
    array[...] = split
    group.attrs[SPLIT] = to_json(dict(facts))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)  # that the journal is no array
        zarr.consolidate_metadata(path, zarr_format=2)
