"""Precomputed skies over a small designed set of climates, and the sky of any climate between them.

For one aerosol type the climates are the nodes of a design: the aerosol's optical depth at every one of its values with
the other parameters in the middle of theirs; and each of the others at its outer values, at two optical depths.  Every
field serves all elevations of the sun.  Between the nodes ln(XYZ) of a direction is interpolated: a local cubic in the
(transformed) optical depth and in the sun's elevation, plus for each other parameter the parabola of its change, linear
in the optical depth between the two where it is known.  Changes with two of the others together are left out.

The interpolated ln(XYZ) is a weighted sum of the nodes' (``Library.weights``), so a trial costs one product.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twilight import colour, solvers, spectrum
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.config.solver import resolve_solver
from twilight.digest import code_digest
from twilight.engine.frames import frames
from twilight.engine.kept import KeptFields, kept_fields
from twilight.errors import TwilightError
from twilight.grids import texture_grid
from twilight.io.whole import whole_file
from twilight.progress import Progress, part_of, silent
from twilight.reading import first_line, open_npz
from twilight.sky import Sky
from twilight.validate.photographs.photo import OBSERVER, PhotoSky, seen_as


@dataclass(frozen=True)
class Parameter:
    """A parameter of the climate: the key it sets, its nodes (the first and last bound it), and its scale.

    Between nodes it is interpolated in ``scaled``: ln for an optical depth, -ln(1 - h) for a relative humidity h, the
    growth of particles going roughly as a power of 1 - h.
    """

    name: str
    key: str
    unit: str
    nodes: tuple[float, ...]
    scale: str

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
    Parameter("ozone", "gases.ozone.column_du", "DU", (200.0, 320.0, 450.0), "linear"),
    Parameter("albedo", "ground.albedo", "1", (0.0, 0.25, 0.6), "linear"),
)
PARAMETERS = {parameter.name: parameter for parameter in (AEROSOL, *OTHERS)}
SUN = "sun"
"""Name of the parameter that is the sun's elevation."""

_SIDE_NODES = (1, -2)
"""Where along the aerosol's nodes the others are varied."""


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
                rows += [{AEROSOL.name: AEROSOL.nodes[i], **middle, p.name: outer} for i in _SIDE_NODES]
        return rows

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M,) of the nodes whose sum of ln(XYZ) is that of a climate between them."""
        x, target = AEROSOL.scaled(np.array(AEROSOL.nodes)), float(AEROSOL.scaled(values[AEROSOL.name]))
        n = len(AEROSOL.nodes)
        out = np.zeros(n + 4 * len(self.others))
        out[:n] = spectrum.hermite_matrix(x, np.array([target]))[0]
        low, high = (range(n)[i] for i in _SIDE_NODES)
        share = float(np.clip((target - x[low]) / (x[high] - x[low]), -0.5, 1.5))
        for j, p in enumerate(self.others):
            a, b, c = p.scaled(np.array(p.nodes))
            q = float(p.scaled(values[p.name]))
            outer = ((q - b) * (q - c) / ((a - b) * (a - c)), (q - a) * (q - b) / ((c - a) * (c - b)))
            for k, weight in enumerate(outer):
                first = n + 4 * j + 2 * k
                for at, main, part in ((first, low, 1.0 - share), (first + 1, high, share)):
                    out[at] += weight * part
                    out[main] -= weight * part
        return out


@dataclass(frozen=True, eq=False)
class Library:
    """Skies of one aerosol type: xyz (M, S, E, A, 3) [cd m^-2] of the design's climates and suns, on one texture."""

    design: Design
    aerosol_type: str
    sun_elevations_deg: np.ndarray
    apparent_elevations_deg: np.ndarray
    xyz: np.ndarray

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M x S,) of all skies; ``values`` holds every parameter of the design, and ``sun`` [deg]."""
        climate = self.design.weights(values)
        if self.sun_elevations_deg.size == 1:
            return climate
        sun = spectrum.hermite_matrix(self.sun_elevations_deg, np.array([values[SUN]]))[0]
        return np.outer(climate, sun).ravel()

    def select(self, low_deg: float, high_deg: float) -> Library:
        """The part whose suns lie between two elevations, ends included; TwilightError where there is none."""
        inside = (self.sun_elevations_deg >= low_deg - 1e-9) & (self.sun_elevations_deg <= high_deg + 1e-9)
        if not inside.any():
            raise TwilightError(f"library: holds no sun between {low_deg:g} and {high_deg:g} deg")
        return replace(
            self,
            sun_elevations_deg=self.sun_elevations_deg[inside],
            apparent_elevations_deg=self.apparent_elevations_deg[inside],
            xyz=self.xyz[:, inside],
        )

    def on(self, photo: PhotoSky) -> np.ndarray:
        """ln(XYZ) of all skies in the cells of a photograph that count, (M x S, n, 3).

        Errors: TwilightError where a sky is black there.
        """
        return np.array([self.cells(photo, xyz) for xyz in self.xyz.reshape(-1, *self.xyz.shape[2:])])

    def cells(self, photo: PhotoSky, xyz: np.ndarray) -> np.ndarray:
        """ln(XYZ) of one sky (E, A, 3) on the library's texture, in the cells of a photograph that count, (n, 3)."""
        e, a, _ = xyz.shape
        grid = Sky(np.array([550.0]), *texture_grid(90.0 / e), np.zeros((e, a, 1)), 0.0)
        values = seen_as(photo, grid, xyz.astype(float))[1][photo.counts]
        if not (values > 0).all():
            raise TwilightError("library: a sky is black where the photograph shows clear sky; choose other suns")
        return np.log(values)


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
    """Compute the skies of a design, or take them from ``file`` where it holds just these; writes ``file`` otherwise.

    Each climate's skies are kept in the user's cache too: who begins again goes on where it was interrupted.

    base: all that the design does not set.  Errors: TwilightError for a climate that has no aerosol to vary, and for a
    file that is damaged or cannot be written.
    """
    if base.climate.medium is not None:
        raise TwilightError(f"{base.title}: a tabulated medium has no aerosol, ozone or humidity to estimate")
    suns = [float(s) for s in sun_elevations_deg]
    configs = [_config(base, design, node, aerosol_type, suns, cell_deg) for node in design.nodes]
    key = _key(configs)
    if file is not None and Path(file).exists():
        stored = _read(Path(file), key)
        if stored is not None:
            return Library(design, aerosol_type, np.array(suns), *stored)
    made = []
    for i, config in enumerate(configs):
        label = f"{aerosol_type}, climate {i + 1} of {len(configs)}:"
        made.append(_skies(config, kept_fields(), part_of(progress, i / len(configs), 1.0 / len(configs), label)))
    apparent, xyz = made[-1][0], np.array([row for _, row in made])
    if file is not None:
        _write(Path(file), key, apparent, xyz)
    return Library(design, aerosol_type, np.array(suns), apparent, xyz)


def _skies(config: Config, kept: KeptFields | None, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
    """Apparent suns (S,) and XYZ (S, E, A, 3) of one climate; computed once as long as the user's cache keeps them.

    Their fields are not kept: they would drive out all others.
    """
    key = _key([config])
    path = None if kept is None else kept.skies_path(key)
    if path is not None and path.exists():
        try:
            stored = _read(path, key)
        except TwilightError:  # damaged
            stored = None
        if stored is not None:
            with contextlib.suppress(OSError):  # a cache that may be read only
                os.utime(path)
            return stored
    skies = [frame.sky for frame in frames(config, progress, keep=False)]
    apparent = np.array(
        [s.sun_elevation_deg if s.apparent_sun_elevation_deg is None else s.apparent_sun_elevation_deg for s in skies]
    )
    xyz = np.array([colour.sky_to_xyz(sky, observer=OBSERVER).astype(np.float32) for sky in skies])
    if kept is not None and path is not None:
        kept.write(path, lambda to: _write(to, key, apparent, xyz))
    return apparent, xyz


def _write(path: Path, key: str, apparent: np.ndarray, xyz: np.ndarray) -> None:
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, key=np.array(key), apparent=apparent, xyz=xyz)


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
    base: Config, design: Design, node: Mapping[str, float], aerosol_type: str, suns: list[float], cell_deg: float
) -> Config:
    settings = climate_settings(design, node, aerosol_type)
    settings |= {"sun": {"elevations_deg": suns}, "texture": {"resolution_deg": cell_deg}}
    return with_settings(base, settings)


def _key(configs: list[Config]) -> str:
    """Of all that the skies depend on: the configurations, and the code that computes them."""
    code = code_digest("twilight.engine.frames", solvers.SOLVERS[resolve_solver(configs[0].solver)[0]])
    text = json.dumps([code, *(c.model_dump(mode="json") for c in configs)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(path: Path, key: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Apparent suns and skies of a stored library, None where it holds others.  Errors: TwilightError if damaged."""
    try:
        with open_npz(path) as stored:
            if str(stored["key"]) != key:
                return None
            return stored["apparent"], stored["xyz"]
    except TwilightError:
        raise
    except Exception as error:  # zipfile, zlib, numpy and the system each have their own
        raise TwilightError(f"{path}: is not a complete library of skies ({first_line(error)})") from None


__all__ = [
    "AEROSOL",
    "OTHERS",
    "PARAMETERS",
    "SUN",
    "Design",
    "Library",
    "Parameter",
    "climate_settings",
    "make_library",
    "with_settings",
]
