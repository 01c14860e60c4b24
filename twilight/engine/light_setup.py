"""The field that a question about light needs: a climate at wavelengths that cover the quantities, with a night."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

from twilight.base.progress import Progress
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.engine.light import LightField
from twilight.engine.solve import solve
from twilight.scene import resolve
from twilight.sky.night import NightLevels
from twilight.sky.quantities.catalogue import Quantity
from twilight.sky.quantities.measure import check_covered, samples_for

MOST_FIELDS = 4
"""Fields that are held in memory for further questions."""
_fields: dict[str, LightField] = {}
"""Fields by their configuration as JSON, the oldest first."""


def field_for(config: Config, quantities: Sequence[Quantity], progress: Progress | None = None) -> LightField:
    """The solved field of a configuration, cached for the next question; its wavelengths, if not given, are chosen.

    Without a `night` of its own it has the usual one.
    Errors: TwilightError for a quantity that the wavelengths do not cover.
    """
    responses = [one for which in quantities for one in which.responses()]
    if config.wavelengths is None and config.climate.medium is None:
        chosen = list(samples_for(responses))
        config = load(config.model_dump(mode="json", exclude_unset=True), {"wavelengths": {"list_nm": chosen}})
    document = json.dumps(config.model_dump(mode="json", exclude_unset=True), sort_keys=True)
    if document not in _fields:
        while len(_fields) >= MOST_FIELDS:
            del _fields[next(iter(_fields))]
        field = LightField.of(solve(resolve(config), progress=progress))
        _fields[document] = field if field.levels is not None else replace(field, levels=NightLevels())
    field = _fields[document]
    for one in responses:
        check_covered(one, field.wavelength_nm, "the field")
    return field
