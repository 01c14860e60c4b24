"""The key under which a solved field is cached: a SHA-256 of all that enters, the solver's code included.

The solver's own file format guards the content of the file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.base.digest import code_digest

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium
    from twilight.solvers.base import Interpolation


def field_key(
    solver: str,
    settings: Any,
    medium: Medium,
    suns_deg: Sequence[float] | None,
    altitude_km: float,
    interpolation: Interpolation | None = None,
) -> str:
    """The key of the field of a problem.

    solver: name of its module; suns_deg: all that will be asked for, None: any; altitude_km: the observer's;
    interpolation: over the spectrum, by which light scattered more than once follows.
    """
    digest = hashlib.sha256(code_digest(solver).encode())
    about = [solver, asdict(settings), None if suns_deg is None else sorted(suns_deg), altitude_km]
    digest.update(json.dumps(about, sort_keys=True, default=str).encode())
    _add(digest, medium)
    _add(digest, medium.at_grid_wavelengths)
    if interpolation is not None:
        _add(digest, interpolation)
    return digest.hexdigest()


def _add(digest: hashlib._Hash, value: object) -> None:
    """Everything in a medium but the notes and the air at other wavelengths."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple):
        for one in value:
            _add(digest, one)
    elif is_dataclass(value):
        for f in fields(value):
            if f.compare and f.name != "notes":
                digest.update(f.name.encode())
                _add(digest, getattr(value, f.name))
    else:
        digest.update(repr(value).encode())
