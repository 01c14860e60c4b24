"""A page whose sliders change the air: the model of all clear air, computed in the browser (`model_text`).

The page holds the model's file and two airs of `clear_air`: what is below the stratosphere, and what is in
it.  Their optical depths are scaled apart and added, which is exact; so is ozone's absorption, which goes with its
column.
"""

import io
from dataclasses import replace
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.base.errors import TwilightError
from twilight.clear_air.entry import HIGHEST_OBSERVER_KM, SHIPPED, check_air, check_medium, shipped_model
from twilight.clear_air.model import NUMBER, SUN_DEG
from twilight.clear_air.of_medium import air_of
from twilight.clear_air.shells import ABSORPTION, EXTINCTION, HIGH, Air
from twilight.engine.table import first_rows, shared_columns
from twilight.numerics.spectrum import VISIBLE_NM, expand, hermite_matrix
from twilight.scene.medium import climate_medium
from twilight.scene.scene import Scene
from twilight.show.page import Pack, Page, program_text
from twilight.show.skies import about_page, add_tones, channel_facts
from twilight.show.tones import Channels
from twilight.sky import colour
from twilight.sky.tone import Light, scotopic_weights

ROWS_DEG = first_rows(0.0, [], 45)
"""Elevations at which the page computes light [deg]; in between it reads it as a `SkyTable`."""
COLUMNS_DEG = shared_columns(31)
"""Azimuths from the sun at which it does [deg]."""
COLOUR_NM = VISIBLE_NM[::10]
"""Wavelengths at which the page has spectra to take their colours [nm]."""
EVERYWHERE_KM = 1e6
"""Distance [km] up to which a screen without an end goes."""
SMALL = 1e-3
"""Change of a logarithm from which its derivative is taken."""


def model_text() -> str:
    """The model of all clear air in JavaScript."""
    return "\n".join(program_text(f"{name}.js") for name in ("shells", "diffuse", "clear_air"))


def check_sliders(scene: Scene, name: str) -> None:
    """TwilightError for a scene whose air the sliders cannot change; name: what errors call it."""
    if scene.solver_name != "compact":
        raise TwilightError(f"{name}: sliders move the sky of the solver compact, not of {scene.solver_name}")
    if scene.medium.overhead_absorption_optical_depth.any():
        raise TwilightError(
            f"{name}: gases.ozone.treatment: sliders have ozone in its layer, not in a filter above the air"
        )
    if scene.bands is not None:
        raise TwilightError(
            f"{name}: a page with sliders has no bands of gases; set climate.gases.water_vapour.column_mm=0 and "
            "climate.gases.oxygen=false"
        )
    check_medium(scene.medium)


def view_air(scene: Scene, *, name: str, start: dict[str, Any] | None = None) -> Page:
    """The page of a scene of the solver `compact` with sliders of aerosol, ozone, ground, altitude and sun.

    name: what the page calls it; start: its first settings, by the names of `web/state.js`.
    Errors: TwilightError for air that the model was not fitted to.
    """
    check_sliders(scene, name)
    medium, config = scene.medium, scene.config
    assert config is not None
    check_air(air_of(medium), medium.wavelength_nm, shipped_model())
    below, above = (air_of(part) for part in _parted(medium))
    column_du, ozone = _ozone(scene, below)
    now, most = _ranges(medium, below, above)
    now["ozone"], most["ozone"] = column_du, 2.0 * column_du
    now["albedo"], most["albedo"] = float(medium.ground_albedo.mean()), 1.0
    channels = Channels(medium.wavelength_nm, config.solar_spectrum)
    pack = Pack(about_page("air", [name], [], now | {"disc": False} | (start or {})))
    count = COLUMNS_DEG.size
    around = [count - 3, count - 2, *range(count), *range(count - 2, 0, -1), 0, 1]
    turn = np.concatenate([[-1, -1], np.ones(count), np.full(count - 2, -1), [1, 1]])
    columns = np.where(turn > 0, COLUMNS_DEG[around], 360.0 - COLUMNS_DEG[around])
    columns[:2] -= 360.0
    columns[-2:] += 360.0
    grid = {"row_deg": ROWS_DEG.tolist(), "column_deg": columns.tolist()}
    pack.header |= grid | {f"spectrum_{key}": nodes for key, nodes in grid.items()}
    pack.header |= {
        "altitude_km": [medium.bottom_km],
        "highest_km": medium.bottom_km + HIGHEST_OBSERVER_KM,
        "sun_deg": [float(SUN_DEG[0]), float(SUN_DEG[-1])],
        "air": {
            "now": now,
            "most": most,
            "column": around,
            "columns": COLUMNS_DEG.tolist(),
            "screen": _screen(medium),
            "model": NUMBER,
        },
        "worker": model_text() + program_text("sky_worker.js"),
    }
    nodes = {"sun_node_deg": [0.0], "spectrum_sun_deg": [0.0], "lift_deg": [[0.0]], "horizon_deg": [0.0]}
    pack.header["fields"].append(channel_facts(channels) | nodes | {"haze_deg": [0.0]})
    logs = np.log(expand(np.exp(SMALL * np.eye(medium.wavelength_nm.size)), medium.wavelength_nm, COLOUR_NM)) / SMALL
    pack.numbers("log_spectrum", logs.T)
    pack.numbers("colour", _colour_weights(config.solar_spectrum))
    pack.numbers("ozone", ozone)
    pack.file("model", SHIPPED.read_bytes())
    for key, air in (("below", below), ("above", above)):
        pack.file(key, _npz(air))
    add_tones(pack)
    return Page(pack, f"{name}: sky")


def _screen(medium: Medium) -> dict[str, Any] | None:
    """What lies beyond the horizon, as the page's model takes it: altitudes above the ground, and powers of T (W,)."""
    screen = medium.screen
    if screen is None:
        return None
    return {
        "altitude": [z - medium.bottom_km for z in screen.altitude_km],
        "transmission": list(screen.transmission),
        "from": screen.from_km,
        "to": min(screen.to_km, EVERYWHERE_KM),
        "powers": screen.powers(medium.wavelength_nm).tolist(),
    }


def _parted(medium: Medium) -> tuple[Medium, Medium]:
    """The medium with the aerosol below the stratosphere alone, and with that above."""
    bottoms = [low for name, low, _ in medium.notes.get("regions", []) if name.startswith("stratosphere")]
    z, extinction = medium.altitude_km, medium.aerosol_extinction_per_km
    lower = (z <= min(bottoms, default=np.inf))[:, None]
    return tuple(replace(medium, aerosol_extinction_per_km=extinction * part) for part in (lower, ~lower))  # type: ignore[return-value]


def _ozone(scene: Scene, air: Air) -> tuple[float, np.ndarray]:
    """The column of ozone [DU] and its optical depths (L, W); 0 where there is none in the air."""
    assert scene.config is not None
    climate, none = scene.config.climate, np.zeros_like(air.depth[ABSORPTION])
    if climate.medium is not None or climate.gases.ozone.treatment != "layer":
        return 0.0, none
    gases = climate.gases.model_copy(update={"ozone": climate.gases.ozone.model_copy(update={"treatment": "none"})})
    without = climate_medium(climate.model_copy(update={"gases": gases}), scene.medium.wavelength_nm)
    absorbed = air.depth[ABSORPTION] - air_of(without).depth[ABSORPTION]
    return float(scene.medium.notes["ozone_column_du"]), absorbed


def _ranges(medium: Medium, below: Air, above: Air) -> tuple[dict[str, float], dict[str, float]]:
    """Optical depths at 550 nm of the aerosol below and in the stratosphere, and the largest of the fitted airs."""
    (_, total), (_, high) = shipped_model().limits[[2, 3]].astype(float)
    now, most = {}, {}
    for name, air, other in (("aerosol", below, above), ("stratosphere", above, below)):
        depth, beside = air.depth[EXTINCTION].sum(axis=0), other.depth[EXTINCTION].sum(axis=0)
        aloft, aloft_beside = air.depth[HIGH].sum(axis=0), other.depth[HIGH].sum(axis=0)
        now[name] = float(np.exp(np.interp(550.0, medium.wavelength_nm, np.log(np.maximum(depth, DARK)))))
        room = (total - beside) / np.maximum(depth, 1e-9), (high - aloft_beside) / np.maximum(aloft, 1e-9)
        if now[name] < 1e-9:
            now[name] = 0.0
        most[name] = now[name] * max(1.0, float(np.min(room)))
    return now, most


def _colour_weights(solar_spectrum: str) -> np.ndarray:
    """Weights of a radiance over F0 at COLOUR_NM in X, Y, Z before they are made as bright as luminance, luminance and
    scotopic luminance, (T, 5)."""
    weights, matrix = colour.xyz_weights(solar_spectrum, 1.0, colour.DEFAULT_OBSERVER)
    night = scotopic_weights(Light(solar_spectrum, 1.0))[:, None]
    every = np.concatenate([weights[:, :3] @ matrix, weights[:, 3:], night], axis=1)
    return hermite_matrix(COLOUR_NM, VISIBLE_NM).T @ every


def _npz(air: Air) -> bytes:
    """The arrays that the page's model takes, in single precision."""
    stream = io.BytesIO()
    arrays = {key: np.asarray(values, "<f4") for key, values in air._asdict().items() if key != "polarising"}
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()
