"""What `import twilight` offers: a sky in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from twilight.config import load
from twilight.engine import frames
from twilight.errors import TwilightError
from twilight.scene.suns import count_suns
from twilight.sky import Sky


def render(
    scene: Any,
    *,
    sun_elevation_deg: float | Sequence[float] | None = None,
    at: Any = None,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    time_zone: str | None = None,
    altitude_km: float | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Sky | list[Sky]:
    """The sky of a climate or configuration (name, file or mapping); a list of them where there are several suns.

    sun_elevation_deg: true elevation(s) of the sun [deg]; or at: a time (text, datetime or pandas' Timestamp) with a
    place, and time_zone where the time has no offset.  settings: any other dotted keys, e.g. {"ground.albedo": 0.8}.
    Errors: TwilightError.
    """
    chosen: dict[str, Any] = {}
    if sun_elevation_deg is not None:
        if at is not None:
            raise TwilightError("render: takes either sun_elevation_deg or at, not both")
        several = not isinstance(sun_elevation_deg, int | float) and hasattr(sun_elevation_deg, "__len__")
        chosen["sun"] = (
            {"elevations_deg": [float(sun) for sun in sun_elevation_deg]}  # type: ignore[union-attr]
            if several
            else {"elevation_deg": float(sun_elevation_deg)}  # type: ignore[arg-type]
        )
    elif at is not None:
        moment = at.isoformat() if hasattr(at, "isoformat") else str(at)
        place = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg, "time_zone": time_zone}
        chosen["sun"] = {"at": moment, **{key: value for key, value in place.items() if value is not None}}
    given = {"observer.altitude_km": altitude_km, "solver.name": solver, "solver.quality": quality}
    chosen |= {key: value for key, value in given.items() if value is not None}
    config = load(scene, {**chosen, **(settings or {})})
    skies = [frame.sky for frame in frames(config)]
    return skies if count_suns(config) > 1 else skies[0]
