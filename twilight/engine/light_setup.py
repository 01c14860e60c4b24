"""The field that a question about light needs: a climate at wavelengths that cover the quantities, with a night."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.engine.light import LightField
from twilight.engine.solve import solve
from twilight.engine.sun_tables import check_serves_every_sun
from twilight.scene import resolve
from twilight.sky.night import NightLevels
from twilight.sky.quantities.measure import Quantity, check_covered, samples_for

MOST_FIELDS = 4
"""Fields that are held in memory for further questions."""
AT_ONCE = {"name": "compact", "polarisation": False}
"""The solver of a configuration that names none and sets nothing of one, where it has the air, the observer and the
wavelengths."""


@dataclass(frozen=True)
class ChosenField:
    """field: what answers; solver: which solver it is of and why, in a sentence, empty where the configuration says."""

    field: LightField
    solver: str


_fields: dict[str, ChosenField] = {}
"""Fields by their configuration as JSON, the oldest first."""


def field_for(config: Config, quantities: Sequence[Quantity], progress: Progress | None = None) -> ChosenField:
    """The solved field of a configuration, cached for the next question; its wavelengths, if not given, are chosen.

    Without a `night` of its own it has the usual one; without a `solver` of its own it is by compact where that serves.
    Errors: TwilightError for a quantity that the wavelengths do not cover, and a solver whose field serves one sun.
    """
    if config.moon is not None and config.moon.elevation_deg is not None:
        raise TwilightError("moon.elevation_deg: light takes the moon from place and time, not from there")
    responses = [one for which in quantities for one in which.responses()]
    if config.wavelengths is None and config.climate.medium is None:
        chosen = list(samples_for(responses))
        config = load(config.model_dump(mode="json", exclude_unset=True), {"wavelengths": {"list_nm": chosen}})
    document = json.dumps(config.model_dump(mode="json", exclude_unset=True), sort_keys=True)
    if document not in _fields:
        while len(_fields) >= MOST_FIELDS:
            del _fields[next(iter(_fields))]
        field, why = _solved(config, progress)
        field = field if field.levels is not None else replace(field, levels=NightLevels())
        _fields[document] = ChosenField(field, why)
    made = _fields[document]
    for one in responses:
        check_covered(one, made.field.wavelength_nm, "the field")
    return made


def _solved(config: Config, progress: Progress | None) -> tuple[LightField, str]:
    if config.solver:
        return _field(config, progress), ""
    try:
        quick = config.model_copy(update={"solver": dict(AT_ONCE)})
        return _field(quick, progress), "solver: compact, the model of all clear air, for none is named"
    except TwilightError as error:
        why = f"solver: {solvers.DEFAULT}, for none is named and compact cannot serve here ({error})"
    return _field(config, progress), why


def _field(config: Config, progress: Progress | None) -> LightField:
    scene = resolve(config)
    check_serves_every_sun(scene)
    return LightField.of(solve(scene, progress=progress))
