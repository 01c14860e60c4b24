"""One rule for the numbers that public functions take: `in_units` reads the unit from the end of a parameter's name.

Plain numbers, numpy's arrays, pandas' series, and arrays of xarray and dask are numbers in the parameter's own unit;
astropy's quantities, and DataArrays whose attribute `units` says another, are converted to it.  DataArrays are paired
by the names of their dimensions.  What is masked, missing, not finite or no number is refused in one sentence.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.threads import one_blas_thread

UNITS = {"deg": "deg", "km": "km", "nm": "nm", "au": "AU", "cd_per_m2": "cd m-2"}
"""The last word of a parameter's name that is its unit, and how astropy writes that."""
SAID: dict[str, dict[str, float]] = {
    "deg": {
        **dict.fromkeys(("deg", "degree", "degrees", "°", "degrees_north", "degrees_east", "degree_north"), 1.0),
        **dict.fromkeys(("degree_east", "degreesN".lower(), "degreesE".lower()), 1.0),
        **dict.fromkeys(("rad", "radian", "radians"), 180.0 / np.pi),
    },
    "km": {
        **dict.fromkeys(("km", "kilometer", "kilometre", "kilometers", "kilometres"), 1.0),
        **dict.fromkeys(("m", "meter", "metre", "meters", "metres"), 1e-3),
    },
    "nm": {
        **dict.fromkeys(("nm", "nanometer", "nanometre", "nanometers", "nanometres"), 1.0),
        **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometre", "micrometers"), 1e3),
        **dict.fromkeys(("m", "meter", "metre"), 1e9),
    },
}
"""What the attribute `units` of a DataArray says, and what its numbers are multiplied with."""
F = TypeVar("F", bound=Callable[..., Any])


def plain(value: Any, name: str, unit: str | None = None) -> Any:
    """A number or an array of numbers of any library as a float or an array of numpy's, in the unit of a parameter.

    name: of the parameter, for the TwilightError; unit: of `UNITS`, None: by the name's end.
    """
    unit = unit_in(name) if unit is None else unit
    if type(value) is float or type(value) is int:
        numbers: Any = value
    elif type(value) is np.ndarray and value.dtype.kind in "fiu":
        numbers = value
    else:
        numbers = _converted(value, name, unit)
    if not np.isfinite(numbers).all():
        raise TwilightError(f"{name}: must be finite, got {_shown(value)}")
    return numbers


def unit_in(name: str) -> str | None:
    """The unit that the name of a parameter ends in; None: in none."""
    return next((unit for unit in UNITS if name.endswith(f"_{unit}")), None)


def in_units(function: F) -> F:
    """The same function with `plain` numbers for all parameters whose names end in a unit, one number where it takes a
    `float`, and products of matrices on one thread; of a class, all its public methods."""
    if isinstance(function, type):
        for name, method in list(vars(function).items()):
            if inspect.isfunction(method) and (name == "__init__" or not name.startswith("_")):
                setattr(function, name, in_units(method))
        return function  # type: ignore[return-value]
    known = inspect.signature(function).parameters
    names = [name if unit_in(name) else None for name in known]
    if not any(names):
        return function
    single = {n for n, p in known.items() if str(p.annotation) in ("float", "float | None", "<class 'float'>")}

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        said = (*zip(names, args, strict=False), *kwargs.items())
        given = {n: v for n, v in said if n is not None and n in names and v is not None}
        for name, value in by_dimension(given).items():
            given[name] = plain(value, name)
            if name in single and np.ndim(given[name]):
                raise TwilightError(f"{name}: must be one number, got {_shown(value)}")
        first = [given.get(n, v) if n else v for n, v in zip(names, args, strict=False)]
        with one_blas_thread():
            return function(*first, *args[len(names) :], **{n: given.get(n, v) for n, v in kwargs.items()})

    return called  # type: ignore[return-value]


def by_dimension(given: dict[str, Any]) -> dict[str, Any]:
    """Arguments of which several are DataArrays along dimensions of other names, broadcast by these names."""
    arrays = {n: v for n, v in given.items() if getattr(v, "dims", ())}
    if len(arrays) < 2 or len({v.dims for v in arrays.values()}) < 2:
        return given
    import xarray  # optional

    try:
        same = xarray.broadcast(*arrays.values())
    except ValueError as error:
        raise TwilightError(f"{', '.join(arrays)}: do not go together: {error}") from None
    units = [v.attrs for v in arrays.values()]
    told = (v.assign_attrs(a) for v, a in zip(same, units, strict=True))
    return {**given, **dict(zip(arrays, told, strict=True))}


def _converted(value: Any, name: str, unit: str | None) -> Any:
    if isinstance(value, list | tuple) and any(hasattr(one, "to_value") for one in value):
        return np.array([_converted(one, name, unit) for one in value])
    factor = 1.0
    if hasattr(value, "to_value"):  # astropy
        value = _of_quantity(value, name, unit)
    elif isinstance(getattr(value, "attrs", None), dict) and hasattr(value, "dims"):  # xarray
        said = value.attrs.get("units")
        known = SAID.get(unit or "", {})
        if said is not None and known:
            if str(said).strip() not in known:
                raise TwilightError(f"{name}: its units are '{said}'; allowed are {', '.join(known)}")
            factor = known[str(said).strip()]
        value = value.data
        if hasattr(value, "to_value"):
            value = _of_quantity(value, name, unit)
    mask = getattr(value, "mask", None)
    if mask is not None and not callable(mask):
        if np.any(mask):
            raise TwilightError(f"{name}: holds masked values; leave them out")
        value = getattr(value, "unmasked", value)
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O" and not any(isinstance(one, bool | str) for one in array.ravel()):
            array = array.astype(float)
    except (TypeError, ValueError):
        array = np.empty((), "O")
    if array.dtype.kind not in "fiu":
        raise TwilightError(f"{name}: must be a number or an array of numbers, got {_shown(value)}")
    numbers = array.astype(float) * factor
    return float(numbers) if numbers.ndim == 0 else numbers


def _of_quantity(value: Any, name: str, unit: str | None) -> Any:
    """The numbers of astropy's quantity in a parameter's unit."""
    try:
        return value.to_value(UNITS[unit] if unit else "")
    except (ValueError, TypeError):  # astropy's UnitConversionError is both
        raise TwilightError(
            f"{name}: is in {getattr(value, 'unit', None) or 'no unit'}; it takes {unit or 'plain numbers'}"
        ) from None


def _shown(value: Any) -> str:
    """A value in a sentence, on one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{type(value).__name__} {text[:40]} ..."
