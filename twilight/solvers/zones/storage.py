"""A solved field as one HDF5 file: the medium, the settings, the sunbeam and the solution."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from twilight.atmosphere.grid_medium import GridMedium
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import Screen
from twilight.base.digest import content_digest
from twilight.base.errors import TwilightError
from twilight.base.reading import check_hdf5
from twilight.base.whole_files import whole_content
from twilight.numerics.phase import PhaseFunction
from twilight.solvers.base import Convergence
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.scattering import Solution
from twilight.solvers.zones.settings import ZonesSettings
from twilight.transport.beam import Beam

FORMAT = "twilight zones field 12"
_MEDIUM = tuple(
    f.name
    for f in fields(Medium)
    if f.name not in ("phase_functions", "earth_radius_km", "screen", "name", "notes", "grid_medium")
)


@dataclass(frozen=True)
class Stored:
    """All that a field is made of: what it was solved for, the sunbeam and the solution of each block of wavelengths.

    requested_settings: of the call; settings: with which it was solved; zenith_range_deg: of the sun.
    """

    medium: Medium
    settings: ZonesSettings
    requested_settings: ZonesSettings
    zenith_range_deg: tuple[float, float]
    beam: Beam
    solutions: Sequence[Solution]
    convergence: Convergence | None


def field_hash(medium: Medium, settings: ZonesSettings, zenith_range_deg: tuple[float, float]) -> str:
    """SHA-256 of all that a solution depends on."""
    physics = {key: value for key, value in asdict(settings).items() if key != "field_file"}
    told = json.dumps([FORMAT, physics, *zenith_range_deg], sort_keys=True)
    return content_digest(medium, medium.at_grid_wavelengths, told)


def _content_hash(beam: Beam, solutions: Sequence[Solution]) -> str:
    """SHA-256 of what was computed: kernels trust the shapes and values of these arrays."""
    return content_digest(beam, *(s.light for s in solutions))


def save(field: Stored, path: str | Path) -> None:
    """Write a field; the file is written whole or not at all.

    Errors: TwilightError where the folder cannot be written.
    """
    import h5py  # start-up

    with whole_content(path) as content, h5py.File(content, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["hash"] = field_hash(field.medium, field.requested_settings, field.zenith_range_deg)
        file.attrs["content"] = _content_hash(field.beam, field.solutions)
        file.attrs["settings"] = json.dumps(asdict(field.settings))
        file.attrs["asked"] = json.dumps(asdict(field.requested_settings))
        file.attrs["zenith_range_deg"] = field.zenith_range_deg
        convergence = field.convergence
        file.attrs["convergence"] = json.dumps(asdict(convergence) if convergence else None)
        _write_medium(file.create_group("medium"), field.medium)
        if field.medium.at_grid_wavelengths is not None:
            _write_medium(file.create_group("grid_medium"), field.medium.at_grid_wavelengths)
        file["beam/pool"], file["beam/layout"] = field.beam.pool, field.beam.layout
        for k, solution in enumerate(field.solutions):
            g = file.create_group(f"solution_{k}")
            g.attrs["orders"], g.attrs["residual"] = solution.orders, solution.residual
            for key, array in solution.light._asdict().items():
                g[key] = array


def read(path: str | Path) -> Stored:
    """Read what `save` wrote.

    Errors: TwilightError for a file that is missing, broken or of another kind.
    """
    import h5py  # start-up

    path = Path(path)
    if not isfile(path):
        raise TwilightError(f"{path}: there is no such file; a field is written by Field.save or solver.field_file")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise TwilightError(f"{path}: is not a field of the zones solver ({FORMAT})")
            check_hdf5(path, file)
            medium = _read_medium(file["medium"])
            if "grid_medium" in file:
                medium = replace(medium, grid_medium=GridMedium.of(_read_medium(file["grid_medium"])))
            settings = ZonesSettings(**json.loads(file.attrs["settings"]))
            requested = ZonesSettings(**json.loads(file.attrs["asked"]))
            zenith_range = tuple(float(x) for x in file.attrs["zenith_range_deg"])
            solutions: list[Solution] = []
            while f"solution_{len(solutions)}" in file:
                g = file[f"solution_{len(solutions)}"]
                light = RadianceField(*(g[key][()] for key in RadianceField._fields))
                solutions.append(Solution(light, int(g.attrs["orders"]), float(g.attrs["residual"])))
            beam = Beam(file["beam/pool"][()], file["beam/layout"][()])
            hashes = field_hash(medium, requested, zenith_range), _content_hash(beam, solutions)  # type: ignore[arg-type]
            if hashes != (file.attrs["hash"], file.attrs["content"]):
                raise TwilightError(f"{path}: its content does not match its hash; solve the field again")
            if not all(np.isfinite(array).all() for s in solutions for array in s.light):
                raise TwilightError(f"{path}: holds values that are not numbers; solve the field again")
            convergence = json.loads(file.attrs["convergence"])
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError) as error:
        raise TwilightError(f"{path}: is not a whole field of the zones solver ({error})") from None
    return Stored(
        medium,
        settings,
        requested,
        zenith_range,  # type: ignore[arg-type]
        beam,
        solutions,
        Convergence(**convergence) if convergence else None,
    )


def _write_medium(group: Any, medium: Medium) -> None:
    group.attrs["earth_radius_km"], group.attrs["name"] = medium.earth_radius_km, medium.name
    for key in _MEDIUM:
        group[key] = getattr(medium, key)
    if medium.screen is not None:
        group.attrs["screen"] = json.dumps(asdict(medium.screen))
    for k, phase in enumerate(medium.phase_functions):
        g = group.create_group(f"phase_function_{k}")
        g.attrs["kind"], g.attrs["name"] = phase.kind, phase.name
        g["asymmetry"], g["log_table"], g["ratios"] = phase.asymmetry, phase.log_table, phase.ratios


def _read_medium(group: Any) -> Medium:
    phases: list[PhaseFunction] = []
    while f"phase_function_{len(phases)}" in group:
        g = group[f"phase_function_{len(phases)}"]
        phases.append(
            PhaseFunction(
                int(g.attrs["kind"]), g["asymmetry"][()], g["log_table"][()], str(g.attrs["name"]), g["ratios"][()]
            )
        )
    return Medium(
        **{key: group[key][()] for key in _MEDIUM},
        phase_functions=tuple(phases),
        screen=_read_screen(group.attrs["screen"]) if "screen" in group.attrs else None,
        earth_radius_km=float(group.attrs["earth_radius_km"]),
        name=str(group.attrs["name"]),
    )


def _read_screen(text: str) -> Screen:
    v = json.loads(text)
    return Screen(tuple(v.pop("altitude_km")), tuple(v.pop("transmission")), **v)


def stored_hash(path: str | Path) -> str | None:
    """Hash of the field in a file; None where there is no file or it holds none."""
    import h5py  # start-up

    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs["hash"]) if file.attrs.get("format") == FORMAT else None
    except (OSError, KeyError):
        return None
