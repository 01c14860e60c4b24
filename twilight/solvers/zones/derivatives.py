"""Derivatives of a field's light by what is in a layer: the whole operator, differentiated in columns.

The wavelengths that a field solves at once share everything but their coefficients: nodes, rays, points, directions.
Here they are one wavelength with a little more absorption in one layer after the other: columns of one field.  What the
sunbeam, the line of sight, all orders of scattering, the ground and the polarisation make of the change is then in the
columns' light, and its derivative is that of the discrete operator itself, by

    f'(0) = (-3 f(0) + 4 f(h) - f(2 h)) / (2 h) + h^2 f'''/3,        f = ln I.

J layers take 2 J + 1 columns, and eight columns the time of one wavelength alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.grid_medium import GridMedium
from twilight.atmosphere.layer_changes import layer_depth, layer_edges, of_layer, with_columns, with_doubled_levels
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.solvers.base import DIFFERENTIATED, Convergence
from twilight.solvers.zones.field import Field
from twilight.solvers.zones.field_grids import FieldGrids
from twilight.solvers.zones.solution import Solution
from twilight.solvers.zones.solve import solve
from twilight.solvers.zones.successive_orders import FEW_ORDERS

DEPTH_STEP = 2e-3
"""Least optical depth h by which a layer's column changes: rounding to float32 is then worth 5e-4 of a vertical
path."""
STEP_PER_KM = 4e-4
"""Least change of the coefficient [km^-1]: tables of the sunbeam hold jumps of 2e-4 and more in closed form, and
smaller ones are off by up to 1 % of themselves for a sun on the horizon."""
ALBEDO_STEP = 0.02
"""Change of an albedo of the ground or of single scattering."""
TOLERANCE = 1e-6
"""Fraction of the light at which orders of scattering end in all columns."""
MAX_REST = 1e-4
"""Fraction of the light that orders beyond FEW_ORDERS may hold: more would be missing from derivatives."""


@dataclass(frozen=True)
class Derivatives:
    """d ln I / dp of a field for N parameters p at each wavelength.

    fields: of the columns of each wavelength, 2 N + 1 of them; step (N, W): h of each parameter
    """

    fields: tuple[Field, ...]
    step: np.ndarray

    def log_slopes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, observer_altitude_km: float | None = None
    ) -> tuple[np.ndarray, None]:
        """d ln I / dp, shape of the directions plus (N, W), nan where there is no light; no standard error."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg)
        found = []
        for field, step in zip(self.fields, self.step.T, strict=True):
            light = field.radiance(*question, observer_altitude_km=observer_altitude_km)
            n = step.size
            with np.errstate(divide="ignore", invalid="ignore"):
                log = np.log(light)
                slope = (4.0 * log[..., 1 : n + 1] - log[..., n + 1 :] - 3.0 * log[..., :1]) / (2.0 * step)
            found.append(np.where(np.isfinite(slope), slope, np.nan))
        return np.stack(found, axis=-1), None


def differentiate(field: Field, quantity: str, edges_km: np.ndarray) -> Derivatives:
    """Derivatives by one of `solvers.base.DIFFERENTIATED`, in the layers between edges_km (J + 1,) [km].

    Errors: TwilightError for edges that are none, and for air whose light takes too many scatterings.
    """
    if quantity == "ground_albedo":
        return by_ground_albedo(field)
    of_layers = {
        "absorption": by_absorption,
        "aerosol_extinction": by_aerosol_extinction,
        "aerosol_albedo": by_aerosol_albedo,
    }
    if quantity not in of_layers:
        raise TwilightError(
            f"derivatives: zones cannot differentiate by {quantity}; it can by {', '.join(DIFFERENTIATED)}"
        )
    return of_layers[quantity](field, edges_km)


def by_absorption(field: Field, edges_km: np.ndarray) -> Derivatives:
    """By the vertical optical depth of absorption in each layer between edges_km (J + 1,) [km]: minus the box factors.

    Errors: TwilightError for edges that are none, and for air whose light takes too many scatterings.
    """
    return _by_depth(field, edges_km, "absorption_per_km")


def by_aerosol_extinction(field: Field, edges_km: np.ndarray) -> Derivatives:
    """By the vertical optical depth of aerosol in each layer, whose albedo and phase functions stay; as above."""
    return _by_depth(field, edges_km, "aerosol_extinction_per_km")


def by_aerosol_albedo(field: Field, edges_km: np.ndarray) -> Derivatives:
    """By the single scattering albedo of the aerosol in each layer; as above."""
    edges = layer_edges(field.medium, edges_km)

    def changed(medium: Medium, layer: int) -> tuple[Medium, Medium, float]:
        key = "aerosol_single_scattering_albedo"
        values = getattr(medium, key)
        inside = of_layer(medium.altitude_km, edges[layer], edges[layer + 1])[:, None]
        h = -ALBEDO_STEP if values[inside[:, 0]].min() > 2.0 * ALBEDO_STEP else ALBEDO_STEP
        if values[inside[:, 0]].max() + 2.0 * h > 1.0:
            raise TwilightError(
                "derivatives by aerosol albedo: zones cannot differentiate where a layer holds albedos near 0 "
                "and near 1"
            )
        return *(with_columns(medium, **{key: values + inside * k * h}) for k in (1.0, 2.0)), h  # type: ignore[return-value]

    return _derivatives(field, edges, edges.size - 1, changed)


def by_ground_albedo(field: Field) -> Derivatives:
    """By the albedo of the ground; as above."""

    def changed(medium: Medium, _: int) -> tuple[Medium, Medium, float]:
        h = ALBEDO_STEP if medium.ground_albedo.max() < 0.5 else -ALBEDO_STEP
        one, two = (replace(medium, ground_albedo=medium.ground_albedo + k * h) for k in (1.0, 2.0))
        return one, two, h

    return _derivatives(field, np.array([]), 1, changed)


def _by_depth(field: Field, edges_km: np.ndarray, key: str) -> Derivatives:
    edges = layer_edges(field.medium, edges_km)

    def changed(medium: Medium, layer: int) -> tuple[Medium, Medium, float]:
        low, high = edges[layer], edges[layer + 1]
        h = max(DEPTH_STEP, STEP_PER_KM * (high - low))
        values = getattr(medium, key)
        inside = of_layer(medium.altitude_km, low, high)[:, None]

        def more(wanted: float) -> Medium:
            # between levels that differ, a little more at both is not quite as much more in between
            rough = values + inside * wanted / (high - low)
            before, after = (layer_depth(v, medium.altitude_km, np.array([low, high]))[0, 0] for v in (values, rough))
            return with_columns(medium, **{key: values + (rough - values) * wanted / (after - before)})

        return more(h), more(2.0 * h), h

    return _derivatives(field, edges, edges.size - 1, changed)


def _derivatives(
    field: Field, edges_km: np.ndarray, count: int, changed: Callable[[Medium, int], tuple[Medium, Medium, float]]
) -> Derivatives:
    """Solve the columns of every wavelength; changed: (the medium of one wavelength with p + h, with p + 2 h, h)."""
    medium = _with_levels(field.medium, edges_km)
    settings = replace(
        field.settings,
        max_orders=min(field.settings.max_orders, FEW_ORDERS),
        tolerance=min(field.settings.tolerance, TOLERANCE),
        target_error=0.0,
        field_file="",
    )
    fields, steps = [], []
    for w in range(medium.n_wavelengths):
        one = medium.select(np.array([w]))
        pairs = [changed(one, k) for k in range(count)]
        columns = _joined([one, *(p[0] for p in pairs), *(p[1] for p in pairs)])
        fields.append(_solved(columns, settings, field))
        steps.append([p[2] for p in pairs])
    return Derivatives(tuple(fields), np.array(steps).T)


def _with_levels(medium: Medium, edges_km: np.ndarray) -> Medium:
    """The medium with doubled levels at the edges, and its grid medium with the same."""
    if edges_km.size == 0:
        return medium
    grid = medium.at_grid_wavelengths
    made = with_doubled_levels(medium, edges_km)
    if grid is None or not np.array_equal(grid.altitude_km, medium.altitude_km):
        return made
    # every other layer has so much more that tables of the sunbeam know of the edges
    guide = with_doubled_levels(grid, edges_km, medium)
    known = sum(of_layer(guide.altitude_km, *edges_km[k : k + 2]) for k in range(0, edges_km.size - 1, 2))
    guide = replace(guide, absorption_per_km=guide.absorption_per_km + STEP_PER_KM * np.asarray(known)[:, None])
    return replace(made, grid_medium=GridMedium.of(guide))


def _joined(media: list[Medium]) -> Medium:
    """Media of one wavelength and the same levels as columns of one medium; phase functions are those of the first."""
    first = media[0].select(np.zeros(len(media), dtype=int))
    keys = (
        "absorption_per_km", "aerosol_extinction_per_km", "aerosol_single_scattering_albedo"
    )  # fmt: skip
    columns = {key: np.concatenate([getattr(m, key) for m in media], axis=1) for key in keys}
    albedo = np.concatenate([m.ground_albedo for m in media])
    return replace(with_columns(first, **columns), ground_albedo=albedo)


def _solved(columns: Medium, settings, field: Field) -> Field:
    """The field of some columns, in the zenith range of a field."""
    grids = FieldGrids.of(columns, settings, field.grids.zenith_range_deg)
    beam = grids.sunbeam()
    solutions: Sequence[Solution] = ()
    convergence: Convergence | None = None
    if settings.max_orders > 1:
        solutions, convergence = solve(grids, beam, silent)
        _check(convergence, field)
    return Field(grids, beam, solutions, convergence, field.observer_altitude_km)


def _check(convergence: Convergence, field: Field) -> None:
    if field.settings.max_orders > FEW_ORDERS and convergence.residual > MAX_REST:
        raise TwilightError(
            f"derivatives: zones cannot differentiate light that takes more than {FEW_ORDERS} scatterings; "
            f"{convergence.residual:.2g} of it is missing; montecarlo can"
        )
