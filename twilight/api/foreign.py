"""Light as other libraries hold it: astropy's quantities, pandas' series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.quantities.measure import Of, Quantity, unit_of

if TYPE_CHECKING:
    import pandas
    import xarray

    from twilight.api.arguments import AstropyQuantity, TimeLike, TimesLike


def quantities_of(
    arrays: Mapping[str, np.ndarray], found: Sequence[Quantity], of: Of
) -> AstropyQuantity | dict[str, AstropyQuantity]:
    """astropy's Quantity, or a mapping of them by variable where there are several."""
    from astropy import units  # optional

    quantities = {}
    for item in found:
        text = unit_of(item, of)
        unit = units.dimensionless_unscaled if text == "1" else units.Unit(text.replace("s-1 m-2", "ph s-1 m-2"))
        quantities[item.variable] = arrays[item.variable] * unit
    return next(iter(quantities.values())) if len(quantities) == 1 else quantities


def frame_of(
    made: xarray.Dataset, time: TimeLike | TimesLike, variables: Sequence[str], zone: str | None
) -> pandas.Series | pandas.DataFrame:
    """pandas' Series along the time, a DataFrame for several quantities or targets; the index is the one that was
    given."""
    import pandas  # optional

    if "place" in made.dims or "time" not in made.dims:
        raise TwilightError("light: returns pandas needs one place and several times")
    if isinstance(time, pandas.DatetimeIndex):
        index = time
    else:
        index = pandas.DatetimeIndex(made["time"].values, tz="UTC").tz_convert(zone or "UTC")
    columns = {}
    for name in variables:
        values = made[name].transpose("time", ...).values
        if values.ndim == 1:
            columns[name] = pandas.Series(values, index, name=name)
        else:
            of = next(str(d) for d in made[name].dims if d != "time")
            labels = made["surface"].values if of == "surface" else range(values.shape[1])
            for k, label in enumerate(labels):
                columns[f"{name} {label}"] = pandas.Series(values[:, k], index, name=f"{name} {label}")
    return next(iter(columns.values())) if len(columns) == 1 else pandas.DataFrame(columns)
