"""Precomputed skies over a small designed set of climates, and the sky of any climate between them.

For one aerosol type the climates are the nodes of a design: the aerosol's optical depth at every one of its values with
the other parameters in the middle of theirs; and each of the others at its outer values, at two optical depths (ozone,
which lies above the aerosol, at one).  Their skies are emulated (`emulator`).

Between the nodes ln(XYZ) of a direction is interpolated: a local cubic in the (transformed) optical depth and in the
sun's elevation, plus for each other parameter the parabola of its change, linear in the optical depth where it is known
at two.  Changes with two of the others together are left out.

The interpolated ln(XYZ) is a weighted sum of the nodes' (``Library.weights``), so a trial costs one product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.numerics import spectrum
from twilight.numerics.grids import texture_grid
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs import emulator
from twilight.studies.validate.photographs.mask import separation_deg
from twilight.studies.validate.photographs.photo import PhotoSky, seen_as


@dataclass(frozen=True)
class Parameter:
    """A parameter of the climate: the key it sets, its nodes (the first and last bound it), and its scale.

    Between nodes it is interpolated in ``scaled``: ln for an optical depth, -ln(1 - h) for a relative humidity h, the
    growth of particles going roughly as a power of 1 - h.  beside: at which one or two of the aerosol's nodes it is
    varied.
    """

    name: str
    key: str
    unit: str
    nodes: tuple[float, ...]
    scale: str
    beside: tuple[int, ...] = (1, 3)

    def scaled(self, value: Any) -> Any:
        """The value in which it is interpolated and fitted."""
        if self.scale == "log":
            return np.log(value)
        if self.scale == "humidity":
            return -np.log(1.0 - np.asarray(value) / 100.0)
        return np.asarray(value, float)

    def value(self, scaled: Any) -> Any:
        """The inverse of ``scaled``."""
        if self.scale == "log":
            return np.exp(scaled)
        if self.scale == "humidity":
            return 100.0 * (1.0 - np.exp(-np.asarray(scaled)))
        return np.asarray(scaled, float)


AEROSOL = Parameter("aerosol", "aerosol.optical_depth_550nm", "1", (0.02, 0.06, 0.15, 0.35, 0.8), "log")
OTHERS = (
    Parameter("humidity", "aerosol.relative_humidity_percent", "%", (50.0, 80.0, 95.0), "humidity"),
    Parameter("ozone", "gases.ozone.column_du", "DU", (200.0, 320.0, 450.0), "linear", (2,)),
    Parameter("albedo", "ground.albedo", "1", (0.0, 0.25, 0.6), "linear"),
    Parameter("horizon", "horizon.screen.clouds.cover", "1", (0.0, 0.5, 1.0), "linear", (2,)),
)
"""What may be estimated besides the aerosol; horizon: clouds beyond the horizon, at the scene's top and distance."""
PARAMETERS = {parameter.name: parameter for parameter in (AEROSOL, *OTHERS)}
SUN = "sun"
"""Name of the parameter that is the sun's elevation."""

HELD_OUT = 2
"""Number of climates in which emulated skies are compared with computed ones."""
HELD_OUT_SEED = 20260315
"""Seed of the generator that draws held-out climates: always the same ones."""
AT_ONCE = 16
"""Skies that are interpolated to the cells of a photograph together."""
LOWEST_DEG = 3.0
"""Elevation [deg] from which on emulated skies are compared with computed ones, as photographs are."""
FROM_SUN_DEG = 10.0
"""Distance from the sun [deg] from which on emulated skies are compared with computed ones."""


@dataclass(frozen=True)
class Design:
    """Which climates a library holds: the aerosol first, the others varied about it.

    nodes: for each climate the value of every parameter.
    """

    others: tuple[Parameter, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (AEROSOL, *self.others)

    @property
    def nodes(self) -> list[dict[str, float]]:
        middle = {p.name: p.nodes[1] for p in self.others}
        rows = [{AEROSOL.name: value, **middle} for value in AEROSOL.nodes]
        for p in self.others:
            for outer in (p.nodes[0], p.nodes[2]):
                rows += [{AEROSOL.name: AEROSOL.nodes[i], **middle, p.name: outer} for i in p.beside]
        return rows

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M,) of the nodes whose sum of ln(XYZ) is that of a climate between them."""
        x, target = AEROSOL.scaled(np.array(AEROSOL.nodes)), float(AEROSOL.scaled(values[AEROSOL.name]))
        n = len(AEROSOL.nodes)
        out = np.zeros(len(self.nodes))
        out[:n] = spectrum.hermite_matrix(x, np.array([target]))[0]
        node = n
        for p in self.others:
            a, b, c = p.scaled(np.array(p.nodes))
            q = float(p.scaled(values[p.name]))
            outer = ((q - b) * (q - c) / ((a - b) * (a - c)), (q - a) * (q - b) / ((c - a) * (c - b)))
            parts = [1.0]
            if len(p.beside) == 2:
                low, high = p.beside
                fraction = float(np.clip((target - x[low]) / (x[high] - x[low]), -0.5, 1.5))
                parts = [1.0 - fraction, fraction]
            for weight in outer:
                for main, part in zip(p.beside, parts, strict=True):
                    out[node] += weight * part
                    out[main] -= weight * part
                    node += 1
        return out


@dataclass(frozen=True, eq=False)
class Library:
    """Skies of one aerosol type: xyz (M, S, E, A, 3) [cd m^-2] of the design's climates and suns, on one texture.

    luminance_error, chromaticity_error: root mean squares of what its skies are off, in ln(luminance) and in u', v'.
    """

    design: Design
    aerosol_type: str
    sun_elevations_deg: np.ndarray
    apparent_elevations_deg: np.ndarray
    xyz: np.ndarray
    luminance_error: float = 0.0
    chromaticity_error: float = 0.0

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M x S,) of all skies; ``values`` holds every parameter of the design, and ``sun`` [deg]."""
        climate = self.design.weights(values)
        if self.sun_elevations_deg.size == 1:
            return climate
        sun = spectrum.hermite_matrix(self.sun_elevations_deg, np.array([values[SUN]]))[0]
        return np.outer(climate, sun).ravel()

    def on(self, photo: PhotoSky) -> np.ndarray:
        """ln(XYZ) of all skies in the cells of a photograph that count, (M x S, n, 3).

        Errors: TwilightError where a sky is black there.
        """
        skies = self.xyz.reshape(-1, *self.xyz.shape[2:])
        parts = [skies[i : i + AT_ONCE] for i in range(0, len(skies), AT_ONCE)]
        return np.concatenate([self._cells(photo, part) for part in parts])

    def cells(self, photo: PhotoSky, xyz: np.ndarray) -> np.ndarray:
        """ln(XYZ) of one sky (E, A, 3) on the library's texture, in the cells of a photograph that count, (n, 3)."""
        return self._cells(photo, xyz[None])[0]

    def _cells(self, photo: PhotoSky, xyz: np.ndarray) -> np.ndarray:
        m, e, a, _ = xyz.shape
        grid = Sky(np.array([550.0]), *texture_grid(90.0 / e), np.zeros((e, a, 1)), 0.0)
        together = np.moveaxis(xyz.astype(float), 0, 2).reshape(e, a, 3 * m)
        values = seen_as(photo, grid, together)[1][photo.counts].reshape(-1, m, 3)
        if not (values > 0).all():
            raise TwilightError("library: a sky is black where the photograph shows clear sky; choose other suns")
        return np.log(np.moveaxis(values, 1, 0))


def make_library(
    base: Config,
    design: Design,
    aerosol_type: str,
    sun_elevations_deg: Sequence[float],
    cell_deg: float,
    *,
    file: str | Path | None = None,
    progress: Progress = silent,
) -> Library:
    """The skies of a design from emulated climates (`emulator`), or from ``file`` where it holds just these; writes
    ``file`` otherwise.

    Each climate is in the user's cache too: the next photograph under a sun of the same window computes none, and
    who begins again goes on where it was interrupted.

    base: all that the design does not set.  Errors: TwilightError for a climate that has no aerosol to vary, and for a
    file that is damaged or cannot be written.
    """
    if base.climate.medium is not None:
        raise TwilightError(f"{base.title}: a tabulated medium has no aerosol, ozone or humidity to estimate")
    suns = [float(s) for s in sun_elevations_deg]
    nodes = emulator.sun_nodes(base, suns)
    quick = emulator.quick(base)
    configs = [_config(quick, design, node, aerosol_type, nodes) for node in design.nodes]
    whole = emulator.key_of(*configs, suns, cell_deg)
    if file is not None and Path(file).exists():
        stored = emulator.read(Path(file), whole)
        if stored is not None:
            return Library(design, aerosol_type, np.array(suns), **_fields(stored))
    steps = len(configs) + HELD_OUT
    made = []
    for i, config in enumerate(configs):
        part = part_of(progress, i / steps, 1.0 / steps, f"{aerosol_type}, climate {i + 1} of {len(configs)}:")
        made.append(_coefficients(config, nodes, part))
    errors = []
    for i in range(HELD_OUT):
        part = part_of(progress, (len(configs) + i) / steps, 1.0 / steps)
        errors.append(_error(quick, design, aerosol_type, nodes, made, i, part))
    rows, columns = texture_grid(cell_deg)
    together = np.concatenate(made, axis=-1)
    xyz = np.array([np.exp(emulator.evaluate(emulator.at_sun(nodes, together, s), s, rows, columns)) for s in suns])
    xyz = np.moveaxis(xyz.reshape(*xyz.shape[:3], len(configs), 3), 3, 0).astype(np.float32)
    apparent = emulator.apparent_elevations_deg(configs[0], suns)
    found = {"apparent": apparent, "xyz": xyz, "error": np.mean(errors, axis=0)}
    if file is not None:
        emulator.write(Path(file), whole, found)
    return Library(design, aerosol_type, np.array(suns), **_fields(found))


def _fields(stored: Mapping[str, np.ndarray]) -> dict[str, Any]:
    luminance, chromaticity = (float(x) for x in stored["error"])
    return {
        "apparent_elevations_deg": stored["apparent"],
        "xyz": stored["xyz"],
        "luminance_error": luminance,
        "chromaticity_error": chromaticity,
    }


def _coefficients(config: Config, suns: Sequence[float], progress: Progress) -> np.ndarray:
    key = emulator.key_of(config, list(suns))
    made = emulator.cached_or_made(key, lambda: {"coefficients": emulator.coefficients(config, suns, progress)})
    return made["coefficients"]


def _error(
    base: Config, design: Design, aerosol_type: str, nodes: Sequence[float], made: Sequence[np.ndarray], number: int,
    progress: Progress,
) -> tuple[float, float]:  # fmt: skip
    """Root mean squares of ln(luminance), its mean over a sky left out, and of the distance in u', v' between emulated
    and computed skies, in a climate, under suns and in directions drawn at random: always the same ones."""
    rng = np.random.default_rng([HELD_OUT_SEED, number])
    values = {}
    for p in design.parameters:
        low, high = p.scaled(np.array([p.nodes[0], p.nodes[-1]]))
        values[p.name] = float(p.value(rng.uniform(low, high)))
    inner = (nodes[0], nodes[-1]) if len(nodes) < 4 else (nodes[1], nodes[-2])
    suns = sorted({float(s) for s in (rng.uniform(*inner, 2) if len(nodes) > 1 else nodes)})
    rows = np.sort(np.degrees(np.arcsin(rng.uniform(np.sin(np.radians(LOWEST_DEG)), 1.0, 8))))
    columns = np.sort(rng.uniform(0.0, 180.0, 10))
    config = _config(base, design, values, aerosol_type, suns)
    key = emulator.key_of(config, suns, rows.tolist(), columns.tolist())

    def make() -> dict[str, np.ndarray]:
        progress(f"{aerosol_type}, how far emulated skies are off", 0.0)
        return {"xyz": np.array(emulator.compute(config, suns, lambda sun: (rows, columns)))}

    exact = emulator.cached_or_made(key, make)["xyz"]
    weights = design.weights(values)
    mixed = np.tensordot(weights, np.array(made, float), 1)
    squares = []
    for sun, xyz in zip(suns, exact, strict=True):
        found = np.exp(emulator.evaluate(emulator.at_sun(nodes, mixed, sun), sun, rows, columns))
        away = separation_deg(rows[:, None], columns[None, :], sun, 0.0) > FROM_SUN_DEG
        ratio = np.log(found[..., 1] / xyz[..., 1])[away]
        distance = (colour.uv_of_xyz(found) - colour.uv_of_xyz(xyz))[away]
        squares.append([ratio.var(), (distance**2).sum(axis=-1).mean()])
    luminance, chromaticity = np.sqrt(np.mean(squares, axis=0))
    return float(luminance), float(chromaticity)


def climate_settings(design: Design, values: Mapping[str, float], aerosol_type: str) -> dict[str, Any]:
    """Dotted keys of a climate of the design."""
    settings: dict[str, Any] = {"aerosol.type": aerosol_type}
    for parameter in design.parameters:
        settings[parameter.key] = float(values[parameter.name])
    return settings


def with_settings(base: Config, settings: Mapping[str, Any]) -> Config:
    """The configuration with dotted keys set."""
    data = base.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    data["climate"].get("gases", {}).get("ozone", {}).pop("day_of_year", None)
    if "aerosol.type" in settings:
        data["climate"].get("aerosol", {}).pop("components", None)
    return load(data, settings)


def _config(
    base: Config, design: Design, values: Mapping[str, float], aerosol_type: str, suns: Sequence[float]
) -> Config:
    settings = climate_settings(design, values, aerosol_type)
    return with_settings(base, settings | {"sun": {"elevations_deg": list(suns)}})
