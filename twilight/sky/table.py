"""`SkyTable`: the light of a sky at nodes, and the one rule by which it is read in any direction.

    L(sun, e, a) = exp(S) + P(theta) exp(A)

S, A: local cubics (:func:`twilight.numerics.spectrum.hermite_weights`) through the nodes of the table, in the sun's
true elevation, the elevation e of the line of sight and its azimuth a from the sun; theta: angle between the line of
sight and the apparent sun; P: the phase function of the column's aerosol, whose logarithm is linear in sqrt(theta).
The second term holds what aerosol scattered once, so that neither S nor A has an aureole; it is absent in air without
aerosol.  An elevation that stands twice among the rows is a break: no cubic goes through it, and at it the upper row
counts.  Light below `DARKEST` of the brightest counts as none.

Everything that shows, stores or measures a sky reads it by this rule: :meth:`SkyTable.light` here, and the shaders that
`export shader` and the page carry, which read the same arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.conventions import DARK, TINY_SINGLE
from twilight.numerics.directions import PHASE_COUNT, scattering_angle_rad
from twilight.numerics.spectrum import hermite_matrix, hermite_weights, linear_weights

DARKEST = 1e-9
"""Light, of the brightest in the table at a wavelength and a sun, that stands for none in logarithms."""

LEAST_REST = 0.01
"""Part of the light seen that at least is not in A, whose spectrum is another one."""

BESIDE_BREAK_DEG = 3e-4
"""How far at most on either side of a break the rows of `plain_grid` stand [deg]."""

BREAK_OF_SAMPLES_DEG = 2.2 * BESIDE_BREAK_DEG
"""Rows of plain samples that are closer are a break [deg]: no other row of `plain_grid` is as close to these two."""

DIRECTIONS_AT_ONCE = 40_000
"""Directions that are read at once, which bounds the memory."""

SUNLIT_AT_ONCE = 5_000
"""Directions under suns of their own that are read at once, which bounds the memory."""

ROWS_AT_ONCE = 64
"""Rows of a grid that are read at once, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class SkyTable:
    """The light of a sky at S suns, R rows of elevation and C columns of azimuth, in W wavelengths or channels.

    sun_elevation_deg (S,): true, increasing; apparent_sun_deg (S,): where refraction shows its centre, or would
    elevation_deg (R,): not decreasing; one that stands twice is a break
    azimuth_deg (C,): from the sun; of a `mirrored` sky from 0 to 180, else increasing within a circle
    smooth, aureole (S, R, C, W): S and A, single floats where a field filled them; aureole None in air without aerosol
    log_phase (PHASE_COUNT, W): ln P at PHASE_ANGLE_RAD [sr^-1], or None
    stokes (S, R, C, 2, W): Q / L and U / L (signs: `twilight.base.conventions`), or None
    mirrored: whether the other half of the sky is the mirror image about the sun's vertical, where U changes its sign
    logarithmic: else S is the light itself, of samples with noise or without light, in straight lines; there is no A
    signed: whether a light that is itself held may be negative
    error, worst: relative error at 95 % of directions that no node stands in, and the largest of them; nan: not known
    """

    sun_elevation_deg: np.ndarray
    apparent_sun_deg: np.ndarray
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    smooth: np.ndarray
    aureole: np.ndarray | None = None
    log_phase: np.ndarray | None = None
    stokes: np.ndarray | None = None
    mirrored: bool = True
    logarithmic: bool = True
    signed: bool = False
    error: float = float("nan")
    worst: float = float("nan")

    # Reading ----------------------------------------------------------------------------------------------------

    def under(self, sun_elevation_deg: float) -> SkyTable:
        """The table of one sun, from those of its neighbours; below the first logarithms fall on straight."""
        nodes, weights = sun_weights(self.sun_elevation_deg, np.array([sun_elevation_deg]))
        matrix = np.zeros(self.sun_elevation_deg.size)
        np.add.at(matrix, nodes[0], weights[0])
        used = np.flatnonzero(matrix)

        def mixed(values: Any) -> Any:
            if values is None:
                return None
            if used.size == 1:
                return values[used]
            return np.tensordot(matrix[used].astype(values.dtype), values[used], axes=1)[None]

        return replace(
            self,
            sun_elevation_deg=np.array([float(sun_elevation_deg)]),
            apparent_sun_deg=np.array(
                [sun_elevation_deg + float(matrix @ (self.apparent_sun_deg - self.sun_elevation_deg))]
            ),
            smooth=mixed(self.smooth),
            aureole=mixed(self.aureole),
            stokes=mixed(self.stokes),
        )

    def light(self, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Light in directions (...) under the table's one sun, (..., W); elevations beyond the rows as at the last."""
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        flat_e, flat_a = elevation.ravel(), azimuth.ravel()
        out = np.empty((flat_e.size, self.smooth.shape[-1]), self.smooth.dtype)
        for k in range(0, flat_e.size, DIRECTIONS_AT_ONCE):
            part = slice(k, k + DIRECTIONS_AT_ONCE)
            place, weight = self._stencil(flat_e[part], flat_a[part])
            parts = [self._gathered(layer, place, weight) for layer in self._layers]
            out[part] = self._sum(parts, flat_e[part], flat_a[part])
        return out.reshape(*elevation.shape, -1)

    def light_under(
        self,
        sun: tuple[np.ndarray, np.ndarray],
        sun_elevation_deg: np.ndarray,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
    ) -> np.ndarray:
        """Light in directions (D,), each under a sun of its own (D,), (D, W); sun: `sun_weights` of the table's suns.

        The table is one of logarithms.
        """
        layers = [layer.reshape(-1, layer.shape[-1]) for layer in self._layers]
        per_sun = self.elevation_deg.size * self.azimuth_deg.size
        bending = self.apparent_sun_deg - self.sun_elevation_deg
        out = np.empty((elevation_deg.size, self.smooth.shape[-1]), self.smooth.dtype)
        for k in range(0, elevation_deg.size, SUNLIT_AT_ONCE):
            part = slice(k, k + SUNLIT_AT_ONCE)
            (nodes, over), e, a = (values[part] for values in sun), elevation_deg[part], azimuth_deg[part]
            place, weight = self._stencil(e, a)
            each = (nodes[:, :, None] * per_sun + place[:, None, :]).reshape(e.size, -1)
            share = (over[:, :, None] * weight[:, None, :]).reshape(e.size, -1).astype(weight.dtype)
            parts = [np.einsum("dk,dkw->dw", share, layer[each]) for layer in layers]
            out[part] = np.exp(parts[0])
            if self.aureole is not None:
                apparent = sun_elevation_deg[part] + (over * bending[nodes]).sum(axis=1)
                out[part] += np.exp(parts[1] + self._log_phase_at(scattering_angle_rad(apparent, e, a)))
        return out

    def on_grid(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Light on rows (E,) and columns (A,) under the table's one sun, (E, A, W): `light`, faster."""
        rows = self._matrix(self.elevation_deg, elevation_deg)
        columns, values = self._columns
        across = self._matrix(columns, self._folded(azimuth_deg))
        out = np.empty((rows.shape[0], across.shape[0], self.smooth.shape[-1]), self.smooth.dtype)
        layers = [values(layer[0]) for layer in self._layers]
        for k in range(0, rows.shape[0], ROWS_AT_ONCE):
            part = slice(k, k + ROWS_AT_ONCE)
            parts = []
            for layer in layers:
                along = np.tensordot(rows[part], layer, axes=1)
                parts.append(np.matmul(across, along))
            out[part] = self._sum(parts, elevation_deg[part][:, None], azimuth_deg)
        return out

    def fractional_stokes(self, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Q / L and U / L in directions (...) under the table's one sun, (..., 2, W); the table must have them."""
        assert self.stokes is not None
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        flat_e, flat_a = elevation.ravel(), azimuth.ravel()
        out = np.empty((flat_e.size, 2, self.stokes.shape[-1]), np.float32)
        for k in range(0, flat_e.size, DIRECTIONS_AT_ONCE):
            part = slice(k, k + DIRECTIONS_AT_ONCE)
            place, weight = self._stencil(flat_e[part], flat_a[part])
            out[part] = self._gathered(
                self.stokes[0].reshape(*self.stokes.shape[1:3], -1)[None], place, weight
            ).reshape(-1, 2, self.stokes.shape[-1])
        if self.mirrored:
            out[np.mod(flat_a, 360.0) > 180.0, 1] *= -1.0
        return out.reshape(*elevation.shape, 2, -1)

    @property
    def _layers(self) -> list[np.ndarray]:
        return [self.smooth] if self.aureole is None else [self.smooth, self.aureole]

    @property
    def _columns(self):
        """Columns with neighbours beyond either end, and a function that gives values (R, C, ...) the same."""
        a, n = self.azimuth_deg, self.azimuth_deg.size
        if n == 1:
            return a, lambda values: values
        if self.mirrored:
            # columns of a part of the sky have no neighbours beyond their ends
            before, after = slice(0, int(a[0] == 0.0)), slice(0, int(a[-1] == 180.0))
            index = np.concatenate([[1][before], np.arange(n), [n - 2][after]]).astype(int)
            places = np.concatenate([[-a[1]][before], a, [360.0 - a[-2]][after]])
        else:
            index = np.concatenate([[n - 2, n - 1], np.arange(n), [0, 1]])
            places = np.concatenate([a[-2:] - 360.0, a, a[:2] + 360.0])
        return places, lambda values: values[:, index]

    def _folded(self, azimuth_deg: np.ndarray) -> np.ndarray:
        """Azimuths as the columns count them."""
        azimuth = np.mod(azimuth_deg, 360.0)
        if self.mirrored:
            return np.minimum(azimuth, 360.0 - azimuth)
        return (
            np.where(azimuth < self.azimuth_deg[0], azimuth + 360.0, azimuth) if self.azimuth_deg.size > 1 else azimuth
        )

    @property
    def _weights(self) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Cubics, but straight lines where light itself is held: beside darkness and noise cubics swing."""
        return hermite_weights if self.logarithmic or self.signed else linear_weights

    def _matrix(self, nodes: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Weights of the nodes (N,) for targets (T,) as a matrix (T, N)."""
        which, weight = self._weights(nodes, target)
        matrix = np.zeros((weight.shape[0], nodes.size), self.smooth.dtype)
        np.add.at(matrix, (np.arange(weight.shape[0])[:, None], which), weight)
        return matrix

    def _stencil(self, elevation: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (D, 16 or 4) in a layer of rows times columns, and their weights."""
        i, u = self._weights(self.elevation_deg, elevation)
        columns, values = self._columns
        number = values(np.arange(self.azimuth_deg.size)[None])[0]
        j, v = self._weights(columns, self._folded(azimuth))
        place = i[:, :, None] * self.azimuth_deg.size + number[j][:, None, :]
        weight = (u[:, :, None] * v[:, None, :]).astype(self.smooth.dtype)
        return place.reshape(elevation.size, -1), weight.reshape(elevation.size, -1)

    def _gathered(self, layer: np.ndarray, place: np.ndarray, weight: np.ndarray) -> np.ndarray:
        flat = layer[0].reshape(-1, layer.shape[-1])
        return np.einsum("dk,dkw->dw", weight, flat[place])

    def _sum(self, parts: list[np.ndarray], elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """exp(S) + P exp(A) of directions (...), from S and A (..., W)."""
        if not self.logarithmic:
            return parts[0] if self.signed else np.maximum(parts[0], 0.0)
        out = np.exp(parts[0], out=parts[0])
        if self.aureole is not None:
            parts[1] += self._log_phase_at(scattering_angle_rad(self.apparent_sun_deg[0], elevation, azimuth))
            out += np.exp(parts[1], out=parts[1])
        out[out <= 2.0 * self._darkest] = 0.0
        return out

    @property
    def _darkest(self) -> np.ndarray:
        """Least light that is held, (W,)."""
        return DARKEST * np.exp(self.smooth[0].max(axis=(0, 1)))

    def _log_phase_at(self, angle: np.ndarray) -> np.ndarray:
        """ln P at angles (...), (..., W)."""
        assert self.log_phase is not None
        return at_angle(self.log_phase.astype(np.float32, copy=False), angle)

    def light_at_nodes(self) -> np.ndarray:
        """Light at the nodes, (S, R, C, W), for what averages or fits it; none is left out as dark."""
        light = np.exp(self.smooth)
        if self.aureole is None:
            return light
        e, a = self.elevation_deg[:, None], self.azimuth_deg
        for s, sun in enumerate(self.apparent_sun_deg):
            light[s] += np.exp(self.aureole[s] + self._log_phase_at(scattering_angle_rad(sun, e, a)))
        return light

    def arrays(self) -> dict[str, np.ndarray]:
        """What the table holds, by name, for files."""
        return {key: np.asarray(value) for key, value in vars(self).items() if value is not None}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> SkyTable:
        """The table of `arrays`; ValueError or TypeError for what is none."""
        fields: Any = {key: value[()] if value.ndim == 0 else value for key, value in arrays.items()}
        table = cls(**fields)
        shape = (
            *(x.size for x in (table.sun_elevation_deg, table.elevation_deg, table.azimuth_deg)),
            table.smooth.shape[-1],
        )
        if table.smooth.shape != shape or not np.isfinite(table.smooth).all():
            raise ValueError("not the table of a sky")
        return table

    # From samples -----------------------------------------------------------------------------------------------

    @classmethod
    def of_samples(cls, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, values: np.ndarray) -> SkyTable:
        """The table of plain samples (E, A, K) >= 0 over the whole circle.

        Logarithms are interpolated where all samples are positive.  Rows as close as those beside a break of
        `plain_grid` are one: a slope across it would swing on both sides.  Below the first row a straight line goes on
        by half a row, beyond the last one the rows of the other side of the zenith follow.
        """
        logarithmic = bool((values > 0.0).all())
        table = cls.of_signed(elevation_deg, azimuth_deg, np.log(values) if logarithmic else values)
        return replace(table, logarithmic=logarithmic, signed=False)

    @classmethod
    def of_signed(cls, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, values: np.ndarray) -> SkyTable:
        """The same of values of either sign, as of Stokes parameters that refer to the vertical."""
        rows, layer = elevation_deg, values
        pair = np.flatnonzero(np.diff(rows) < BREAK_OF_SAMPLES_DEG)
        if pair.size:
            rows = rows.astype(float)
            rows[pair] = rows[pair + 1] = 0.5 * (rows[pair] + rows[pair + 1])
        if rows.size > 1 and rows[-1] < 90.0:
            columns = np.concatenate([azimuth_deg[-2:] - 360.0, azimuth_deg, azimuth_deg[:2] + 360.0])
            around = np.concatenate([layer[-2:, -2:], layer[-2:], layer[-2:, :2]], axis=1)[::-1]
            first = azimuth_deg[0]
            across = hermite_matrix(columns, first + np.mod(azimuth_deg + 180.0 - first, 360.0))
            layer = np.concatenate([layer, np.matmul(across, around)])
            rows = np.concatenate([rows, 180.0 - rows[-2:][::-1]])
        if elevation_deg.size > 1 and elevation_deg[0] > 0.0:
            low = max(0.0, 1.5 * rows[0] - 0.5 * rows[1])
            f = (rows[0] - low) / (rows[1] - rows[0])
            layer = np.concatenate([(1.0 + f) * layer[:1] - f * layer[1:2], layer])
            rows = np.concatenate([[low], rows])
        sun = np.zeros(1)
        layer = layer[None].astype(np.result_type(values.dtype, np.float32))
        return cls(sun, sun, rows, azimuth_deg, layer, mirrored=False, logarithmic=False, signed=True)

    # Other tables of the same sky -------------------------------------------------------------------------------

    def seen(self, see: Callable[[np.ndarray], np.ndarray]) -> SkyTable:
        """The table of what is seen of the light: of channels (..., K) of spectra (..., W), not negative."""
        smooth = np.exp(self.smooth.astype(float))
        if self.aureole is None or self.log_phase is None:
            return replace(self, smooth=_log(see(smooth)), stokes=None)
        phase = np.exp(self.log_phase.astype(float))
        log_phase = np.log(np.maximum(see(phase) / see(np.ones_like(phase[:1])), DARK)).astype(np.float32)
        channels = replace(self, log_phase=log_phase)
        parts = []
        for s, sun in enumerate(self.apparent_sun_deg):
            angle = scattering_angle_rad(sun, self.elevation_deg[:, None], self.azimuth_deg)
            once = np.exp(self.aureole[s].astype(float) + self._log_phase_at(angle))
            whole, part = see(smooth[s] + once), see(once)
            rest = np.maximum(whole - part, LEAST_REST * whole)
            parts.append((rest, (whole - rest) / np.exp(channels._log_phase_at(angle))))
        rest, once = (np.stack(part) for part in zip(*parts, strict=True))
        return replace(channels, smooth=_log(rest), aureole=_log(once), stokes=None)

    def at_nodes(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> SkyTable:
        """The same light at other rows and columns (within those of the table), by its own rule."""
        rows, (columns, values) = hermite_matrix(self.elevation_deg, elevation_deg), self._columns
        # the lower one of two equal rows belongs to what is below the break
        for n in np.flatnonzero(np.diff(elevation_deg) == 0.0):
            twice = np.flatnonzero(self.elevation_deg == elevation_deg[n])
            rows[n] = 0.0
            rows[n, twice[0] if twice.size else np.argmin(np.abs(self.elevation_deg - elevation_deg[n]))] = 1.0
        across = hermite_matrix(columns, azimuth_deg)

        def read(layer: Any) -> Any:
            if layer is None:
                return None
            flat = layer.reshape(*layer.shape[:3], -1)
            layer_values = np.stack([np.matmul(across, np.tensordot(rows, values(one), axes=1)) for one in flat])
            return layer_values.reshape(layer.shape[0], rows.shape[0], across.shape[0], *layer.shape[3:]).astype(
                np.float32
            )

        return replace(
            self,
            elevation_deg=elevation_deg,
            azimuth_deg=azimuth_deg,
            smooth=read(self.smooth),
            aureole=read(self.aureole),
            stokes=read(self.stokes),
        )


def sun_weights(suns_deg: np.ndarray, target_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Four suns of a table (T, 4, int) and their weights in logarithms under others (T,): local cubics, a straight line
    below the first two."""
    nodes, weights = hermite_weights(suns_deg, target_deg)
    if suns_deg.size > 1:
        beyond = np.maximum(suns_deg[0] - target_deg, 0.0) / (suns_deg[1] - suns_deg[0])
        below = beyond > 0.0
        nodes[below] = [0, 1, 1, 1]
        weights[below] = np.stack([1.0 + beyond, -beyond, 0.0 * beyond, 0.0 * beyond], axis=1)[below]
    return nodes, weights


def stack(tables: Sequence[SkyTable]) -> SkyTable:
    """One table of the suns of several, in their order, whose nodes and wavelengths are the same."""
    if len(tables) == 1:
        return tables[0]
    layers = ("sun_elevation_deg", "apparent_sun_deg", "smooth", "aureole", "stokes")
    return replace(tables[0], **{name: _all_of(tables, name, 0) for name in layers})


def join(tables: Sequence[SkyTable]) -> SkyTable:
    """One table of the wavelengths of several, of the same suns: on all their rows and columns."""
    if len(tables) == 1:
        return tables[0]
    rows = np.unique(np.concatenate([t.elevation_deg for t in tables]))
    breaks = np.unique(np.concatenate([t.elevation_deg[1:][np.diff(t.elevation_deg) == 0.0] for t in tables]))
    rows = np.sort(np.concatenate([rows, breaks]))
    columns = np.unique(np.concatenate([t.azimuth_deg for t in tables]))
    parts = [t.at_nodes(rows, columns) for t in tables]
    layers = {name: _all_of(parts, name, -1) for name in ("smooth", "aureole", "log_phase", "stokes")}
    return replace(parts[0], **layers, error=max(t.error for t in tables), worst=max(t.worst for t in tables))


def _all_of(tables: Sequence[SkyTable], name: str, axis: int) -> Any:
    values = [getattr(table, name) for table in tables]
    return None if any(value is None for value in values) else np.concatenate(values, axis=axis)


def _log(light: np.ndarray) -> np.ndarray:
    """ln of light (S, R, C, W), float32, not below DARKEST of its largest."""
    least = np.maximum(DARKEST * light.max(axis=(1, 2), keepdims=True), TINY_SINGLE)
    return np.log(np.maximum(light, least)).astype(np.float32)


def split(
    light: np.ndarray,
    once: np.ndarray | None,
    angle_rad: np.ndarray,
    log_phase: np.ndarray | None,
    largest_fraction: float = 0.98,
    rest: float = 0.01,
) -> tuple[np.ndarray, np.ndarray | None]:
    """S and A (S, R, C, W) of light and what aerosol scattered once of it, about.

    angle_rad (S, R, C): scattering angles.  A holds at most `largest_fraction` of the light, so that something is left
    for S, and the fraction `rest` of all else, so that its logarithm does not fall without end in the shadow.
    """
    light = np.maximum(light, np.maximum(DARKEST * light.max(axis=(1, 2), keepdims=True), TINY_SINGLE)).astype(float)
    if once is None or log_phase is None:
        return np.log(light).astype(np.float32), None
    part = np.minimum(once, largest_fraction * light)
    part = part + rest * (light - part)
    phase = at_angle(log_phase, angle_rad)
    return np.log(light - part).astype(np.float32), (np.log(part) - phase).astype(np.float32)


def at_angle(table: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Values at angles (...) of a table (PHASE_COUNT, W) at PHASE_ANGLE_RAD, (..., W)."""
    u = np.sqrt(angle_rad / np.pi) * (PHASE_COUNT - 1)
    k = np.minimum(u.astype(int), PHASE_COUNT - 2)
    f = (u - k)[..., None].astype(table.dtype)
    return np.asarray((1.0 - f) * table[k] + f * table[k + 1])
