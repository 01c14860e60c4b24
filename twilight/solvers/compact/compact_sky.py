"""A clear sky in a few hundred kilobytes: sun-normalised spectral radiance from day to the end of twilight.

This file needs numpy and nothing else, and may be copied out of the package.

    from twilight.solvers.compact.compact_sky import CompactSky

    model = CompactSky.load("continental-average.npz")
    sky = model.sky(sun_elevation_deg=-4.0, wavelength_nm=[450, 550, 650], optical_depth_550nm=0.15, ground_albedo=0.1)
    sky.radiance(elevation_deg=20.0, azimuth_deg=0.0)  # L / F0 [sr^-1], (3,); times the solar irradiance: radiance
    sky.on_grid(elevation_deg=[10.0, 20.0], azimuth_deg=[0.0, 90.0, 180.0])  # (2, 3, 3): rows times columns, faster

*The model.*  With the sun at elevation s, over ground of albedo A, in air of aerosol optical depth tau (550 nm) and
ozone column z, the radiance factor at wavelength w in a direction at elevation e and azimuth a from the sun is

    L / F0 = exp((x_dark + x_ozone) . phi) + A / (1 - A r(w, tau)) exp((x_ground + x_ozone) . phi)

The first term is the sky over black ground, the second the light that the ground adds; r is the fraction of the light
from the ground that the air sends back down.  phi(e, a, s) are K cubic B-splines of which 20 are not 0:

    (n_e + 3) x (n_a + 1)  products of splines over (e / 90)^(1 / p) n_e and over a / 180 n_a, even in a at both ends
    n_t + 3                splines over ln(1 + T / t0) / ln(1 + 180 / t0) n_t, T the angle from the sun [deg]

x_dark and x_ground, (K,) each, are smooth functions of s, w and tau, x_ozone of s, w and z:

    x[k] = sum over b, c, d, f of core[b, c, d, f] shape[b, k] sun[c](s) wavelength[d](w) amount[f](tau or z)

(Tucker's decomposition).  sun[c] is the cubic spline (not-a-knot) through its values at the nodes s_i, amount[f] the
same over ln(tau + tau0) or over z (three nodes: a parabola), wavelength[d] is linear between nodes 1 nm apart.

*The file* is a numpy .npz without pickled objects:

    format                   text, "twilight compact sky 1"
    documentation            text, this docstring
    provenance               text, JSON: climate, solver, quality, version, hash, cost, errors
    sun_elevation_deg        (S,) nodes [deg]
    wavelength_nm            (W,) nodes [nm]
    optical_depth_550nm      (T,) nodes; load_offset: tau0
    ozone_column_du          (Z,) nodes [DU]; ozone_reference_du: the climate's own, where x_ozone is 0
    elevation_intervals, azimuth_intervals, angle_intervals, elevation_power, angle_scale_deg
                             n_e, n_a, n_t, p, t0
    dark_core, dark_shape, dark_sun, dark_wavelength, dark_amount
                             (B, C, D, F), (B, K), (C, S), (D, W), (F, T); ground_* and ozone_* likewise (ozone: (F, Z))
    returned                 (W, T), r at the nodes
    air_*                    the air that the model was fitted to, by which `twilight render --solver compact` knows it
                             again (twilight/solvers/compact/recognise.py); models work without

Angles: elevation of the sun is true (without refraction), elevation of the direction is apparent, from 0 to 90 deg;
azimuth is from the sun, either way.  Observer on the ground.  The sun's disc is not part of the sky.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

FORMAT = "twilight compact sky 1"
"""The array `format` of a file."""

TERMS = ("dark", "ground", "ozone")
"""The sums x of the model, each stored as a Tucker decomposition."""

ARRAYS = ("sun_elevation_deg", "wavelength_nm", "optical_depth_550nm", "ozone_column_du", "returned")
"""Arrays of a file that are fields of `CompactSky`."""

NUMBERS = ("load_offset", "ozone_reference_du")
"""Single numbers of a file that are fields of `CompactSky`."""

AIR = "air_"
"""First letters of the arrays that say to which air the model was fitted."""

_CHUNK = 4096
"""Directions that are evaluated at once, so that large pictures need little memory."""

LARGEST_ARRAY_BYTES = 64e6
"""A file that says to hold larger arrays is refused before memory is taken."""

DAMAGE = (KeyError, ValueError, TypeError, EOFError, RuntimeError, AttributeError, BadZipFile, zlib.error)
"""What reading a damaged file may raise."""


class CompactSkyError(ValueError):
    """What was asked for lies outside the model, or the file is not one; one sentence."""


@dataclass(frozen=True)
class SkySplines:
    """The splines over the sky; see the module's docstring."""

    elevation_intervals: int
    azimuth_intervals: int
    angle_intervals: int
    elevation_power: float
    angle_scale_deg: float

    @property
    def size(self) -> int:
        """K, the number of splines."""
        return (self.elevation_intervals + 3) * (self.azimuth_intervals + 1) + self.angle_intervals + 3

    def splines(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """(index (20, D), value (20, D)) of the splines that are not 0, for directions (D,) [deg]."""
        n_e, n_a = self.elevation_intervals, self.azimuth_intervals
        (row, of_row), (column, of_column) = self._rows(elevation_deg), self._columns(azimuth_deg)
        ring, of_ring = self._rings(sun_elevation_deg, elevation_deg, azimuth_deg)
        index = np.concatenate(
            [(row[:, None] * (n_a + 1) + column[None]).reshape(16, -1), (n_e + 3) * (n_a + 1) + ring]
        )
        value = np.concatenate([(of_row[:, None] * of_column[None]).reshape(16, -1), of_ring])
        return index, value

    def on_rows_and_columns(
        self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The sums (E, A, V) of coefficients (K, V) times splines on a grid of elevations (E,) and azimuths (A,) [deg].

        The products of splines are two multiplications of matrices there.
        """
        n_rows, n_columns = self.elevation_intervals + 3, self.azimuth_intervals + 1
        over_e = _dense(*self._rows(elevation_deg), n_rows)
        over_a = _dense(*self._columns(azimuth_deg), n_columns)
        of_sky = coefficients[: n_rows * n_columns].reshape(n_rows, n_columns, -1)
        half = np.tensordot(over_a, of_sky, (1, 1))  # (A, rows, V)
        out = np.ascontiguousarray(np.tensordot(over_e, half, (1, 1)))
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        ring, of_ring = self._rings(sun_elevation_deg, e.ravel(), a.ravel())
        around = coefficients[n_rows * n_columns :]
        flat = out.reshape(-1, out.shape[-1])
        for rows, weight in zip(ring, of_ring, strict=True):
            flat += weight[:, None] * around[rows]
        return out

    def _rows(self, elevation_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) of the splines over elevations (D,) [deg] that are not 0."""
        e, n_e = np.asarray(elevation_deg, float), self.elevation_intervals
        return _bspline((np.clip(e, 0.0, 90.0) / 90.0) ** (1.0 / self.elevation_power) * n_e, n_e)

    def _columns(self, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) over azimuths (D,) [deg], which are mirrored at 0 and 180 deg."""
        n_a = self.azimuth_intervals
        column, of_column = _bspline(_folded(azimuth_deg) / 180.0 * n_a, n_a)
        column = np.abs(column - 1)
        return np.where(column > n_a, 2 * n_a - column, column), of_column

    def _rings(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) over the angle from the sun, of directions (D,)."""
        e, n_t = np.asarray(elevation_deg, float), self.angle_intervals
        half_e, half_a = np.radians(0.5 * (e - sun_elevation_deg)), np.radians(0.5 * _folded(azimuth_deg))
        cosines = np.cos(np.radians(e)) * np.cos(np.radians(sun_elevation_deg))
        haversine = np.sin(half_e) ** 2 + cosines * np.sin(half_a) ** 2
        angle = np.degrees(2.0 * np.arcsin(np.sqrt(np.clip(haversine, 0.0, 1.0))))
        return _bspline(np.log1p(angle / self.angle_scale_deg) / np.log1p(180.0 / self.angle_scale_deg) * n_t, n_t)


def _folded(azimuth_deg) -> np.ndarray:
    """Azimuths from the sun within 0 to 180 deg."""
    return np.abs(np.mod(np.asarray(azimuth_deg, float) + 180.0, 360.0) - 180.0)


def _dense(index: np.ndarray, value: np.ndarray, n: int) -> np.ndarray:
    """Splines (4, D) as a matrix (D, n); two of them may be the same one, mirrored."""
    out = np.zeros((index.shape[1], n))
    for column, one in zip(index, value, strict=True):
        out[np.arange(index.shape[1]), column] += one
    return out


def _bspline(x: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Index (4, D) and value (4, D) of the uniform cubic B-splines at x from 0 to n."""
    first = np.minimum(x.astype(np.int64), n - 1)
    u = x - first
    v = 1.0 - u
    value = np.stack([v**3, 3.0 * u**3 - 6.0 * u**2 + 4.0, 3.0 * v**3 - 6.0 * v**2 + 4.0, u**3]) / 6.0
    return first + np.arange(4)[:, None], value


def spline_matrix(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The cubic spline (not-a-knot) through values at the nodes (N,), as a matrix (X, N) that gives its values at x.

    Two nodes make a line, three a parabola.
    """
    nodes, x = np.asarray(nodes, float), np.asarray(x, float)
    n = nodes.size
    if n < 4:
        powers = np.arange(n)
        shift, scale = nodes[0], max(float(np.ptp(nodes)), 1e-300)
        to_powers = np.linalg.inv(((nodes[:, None] - shift) / scale) ** powers)
        return ((x[:, None] - shift) / scale) ** powers @ to_powers
    h = np.diff(nodes)
    left, right = np.zeros((n, n)), np.zeros((n, n))  # left @ (second derivatives) = right @ (values)
    for i in range(1, n - 1):
        left[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i, i - 1 : i + 2] = 6.0 / h[i - 1], -6.0 / h[i - 1] - 6.0 / h[i], 6.0 / h[i]
    left[0, :3] = h[1], -(h[0] + h[1]), h[0]  # one cubic across the second and the last but one node
    left[-1, -3:] = h[-1], -(h[-2] + h[-1]), h[-2]
    second = np.linalg.solve(left, right)
    j = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, n - 2)
    b = (x - nodes[j]) / h[j]
    a = 1.0 - b
    out = ((a**3 - a) * h[j] ** 2 / 6.0)[:, None] * second[j] + ((b**3 - b) * h[j] ** 2 / 6.0)[:, None] * second[j + 1]
    rows = np.arange(x.size)
    out[rows, j] += a
    out[rows, j + 1] += b
    return out


def _linear_matrix(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Linear interpolation between increasing nodes (N,), as a matrix (X, N)."""
    j = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    b = (x - nodes[j]) / (nodes[j + 1] - nodes[j])
    out = np.zeros((x.size, nodes.size))
    out[np.arange(x.size), j] = 1.0 - b
    out[np.arange(x.size), j + 1] = b
    return out


@dataclass(frozen=True)
class TuckerTerm:
    """One of the sums of a sky, decomposed: core (B, C, D, F), shape (B, K), sun (C, S), wavelength (D, W) and amount
    (F, T), of aerosol or of ozone."""

    core: np.ndarray
    shape: np.ndarray
    sun: np.ndarray
    wavelength: np.ndarray
    amount: np.ndarray

    def __post_init__(self) -> None:
        """One layout in memory, on which the order of sums depends: the same digits before and after a file."""
        for f in fields(self):
            object.__setattr__(self, f.name, np.ascontiguousarray(getattr(self, f.name)))

    def coefficients(self, sun: np.ndarray, wavelength: np.ndarray, amount: np.ndarray) -> np.ndarray:
        """x (K, V) from the weights of the nodes: sun (S,), wavelength (V, W), amount (T,)."""
        here = self.core.astype(float) @ (self.amount @ amount)
        at_sun = np.einsum("bcd,c->bd", here, self.sun @ sun)
        return self.shape.astype(float).T @ at_sun @ (self.wavelength @ wavelength.T)


@dataclass(frozen=True)
class CompactSky:
    """The skies of one climate; `load` reads them from a file, `sky` gives one of them."""

    grid: SkySplines
    sun_elevation_deg: np.ndarray
    wavelength_nm: np.ndarray
    optical_depth_550nm: np.ndarray
    load_offset: float
    ozone_column_du: np.ndarray
    ozone_reference_du: float
    dark: TuckerTerm
    ground: TuckerTerm
    ozone: TuckerTerm
    returned: np.ndarray
    provenance: dict[str, Any] = field(default_factory=dict)
    air: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | os.PathLike) -> CompactSky:
        """Read a model from its file.

        Raises
        ------
        CompactSkyError
            Where the file is missing, damaged or no model.
        """
        try:
            _check_size(path)
            with np.load(path, allow_pickle=False) as data:
                if str(data["format"]) != FORMAT:
                    raise CompactSkyError(f"{path}: is not a compact sky of format '{FORMAT}'")
                grid = SkySplines(**{f.name: data[f.name].item() for f in fields(SkySplines)})
                terms: dict[str, Any] = {
                    t: TuckerTerm(**{f.name: data[f"{t}_{f.name}"] for f in fields(TuckerTerm)}) for t in TERMS
                }
                arrays = {name: data[name] for name in ARRAYS}
                numbers = {name: data[name].item() for name in NUMBERS}
                air = {name.removeprefix(AIR): data[name] for name in data.files if name.startswith(AIR)}
                made = cls(
                    grid=grid, **arrays, **numbers, **terms, provenance=json.loads(str(data["provenance"])), air=air
                )
        except OSError as error:
            raise CompactSkyError(f"{path}: cannot be read: {error.strerror or error}") from None
        except CompactSkyError:
            raise
        except DAMAGE as error:
            raise CompactSkyError(f"{path}: is not a compact sky: {' '.join(str(error).split())}") from None
        made._check_shapes(str(path))
        return made

    def __repr__(self) -> str:
        """Five lines: what the model covers."""

        def ends(nodes: np.ndarray) -> str:
            return f"{nodes[0]:g} to {nodes[-1]:g}"

        named = self.provenance.get("climate") or self.provenance.get("name") or ""
        return (
            f"<CompactSky{f' of {named}' if isinstance(named, str) and named else ''}\n"
            f"  sun elevation {ends(self.sun_elevation_deg)} deg, wavelength {ends(self.wavelength_nm)} nm\n"
            f"  aerosol optical depth at 550 nm {ends(self.optical_depth_550nm)}, ground albedo 0 to 1\n"
            f"  ozone {ends(self.ozone_column_du)} DU, of the climate {self.ozone_reference_du:g}\n"
            f"  .sky(sun_elevation_deg, wavelength_nm, optical_depth_550nm, ground_albedo, ozone_column_du)>"
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of the file, by name."""
        out: dict[str, Any] = {"format": FORMAT, "documentation": __doc__, "provenance": json.dumps(self.provenance)}
        for name in (*ARRAYS, *NUMBERS):
            out[name] = getattr(self, name)
        for f in fields(SkySplines):
            out[f.name] = getattr(self.grid, f.name)
        for term in TERMS:
            for f in fields(TuckerTerm):
                out[f"{term}_{f.name}"] = getattr(getattr(self, term), f.name)
        out |= {AIR + name: value for name, value in self.air.items()}
        return {name: np.asarray(value) for name, value in out.items()}

    def sky(
        self,
        sun_elevation_deg: float,
        wavelength_nm: Sequence[float] | np.ndarray | float,
        optical_depth_550nm: float,
        ground_albedo: Sequence[float] | np.ndarray | float = 0.0,
        ozone_column_du: float | None = None,
    ) -> OneSky:
        """The sky of one sun, aerosol load, ground and ozone column.

        Parameters
        ----------
        sun_elevation_deg
            True elevation of the sun [deg].
        wavelength_nm : (V,)
            Wavelengths [nm].
        optical_depth_550nm
            Vertical optical depth of the aerosol at 550 nm.
        ground_albedo : scalar or (V,)
            Lambertian albedo, 0 to 1.
        ozone_column_du
            Ozone column [DU]; None: the climate's own.

        Raises
        ------
        CompactSkyError
            For what the model was not fitted to, and for an albedo outside 0 to 1.
        """
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, float))
        ozone = self.ozone_reference_du if ozone_column_du is None else ozone_column_du
        for name, values, nodes, unit in (
            ("sun_elevation_deg", sun_elevation_deg, self.sun_elevation_deg, " deg"),
            ("wavelength_nm", wavelength, self.wavelength_nm, " nm"),
            ("optical_depth_550nm", optical_depth_550nm, self.optical_depth_550nm, ""),
            ("ozone_column_du", ozone, self.ozone_column_du, " DU"),
        ):
            _check_range(name, np.asarray(values, float), float(nodes[0]), float(nodes[-1]), unit)
        albedo = np.asarray(ground_albedo, float)
        _check_range("ground_albedo", albedo, 0.0, 1.0, "")
        if albedo.shape not in ((), (1,), wavelength.shape):
            raise CompactSkyError(f"ground_albedo has {albedo.size} values for {wavelength.size} wavelengths")
        sun = spline_matrix(self.sun_elevation_deg, np.array([float(sun_elevation_deg)]))[0]
        spectral = _linear_matrix(self.wavelength_nm, wavelength)
        loads = np.log(self.optical_depth_550nm + self.load_offset)
        load = spline_matrix(loads, np.array([np.log(optical_depth_550nm + self.load_offset)]))[0]
        column = spline_matrix(self.ozone_column_du, np.array([float(ozone)]))[0]
        change = self.ozone.coefficients(sun, spectral, column)
        return OneSky(
            self.grid,
            float(sun_elevation_deg),
            self.dark.coefficients(sun, spectral, load) + change,
            self.ground.coefficients(sun, spectral, load) + change if albedo.any() else None,
            albedo / (1.0 - albedo * (spectral @ self.returned @ load)),
        )

    def _check_shapes(self, path: str) -> None:
        s, w, t = self.sun_elevation_deg.size, self.wavelength_nm.size, self.optical_depth_550nm.size
        for name in TERMS:
            term = getattr(self, name)
            sizes = (self.grid.size, s, w, self.ozone_column_du.size if name == "ozone" else t)
            factors = (term.shape, term.sun, term.wavelength, term.amount)
            fits = term.core.ndim == 4 and all(
                f.shape == (rank, size) for f, rank, size in zip(factors, term.core.shape, sizes, strict=True)
            )
            if not fits:
                raise CompactSkyError(f"{path}: is not a compact sky: the arrays {name}_* do not fit together")
        if self.returned.shape != (w, t):
            raise CompactSkyError(f"{path}: is not a compact sky: the array returned does not fit the others")


@dataclass(frozen=True)
class OneSky:
    """The sky of one sun: exp of a sum of splines, over black ground, and another sum for the light of the ground.

    dark, ground (K, V): coefficients of the splines; ground_weight (V,): factor on the light of the ground
    """

    grid: SkySplines
    sun_elevation_deg: float
    dark: np.ndarray
    ground: np.ndarray | None
    ground_weight: np.ndarray

    def radiance(self, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance L / F0 in directions above the horizon.

        Parameters
        ----------
        elevation_deg, azimuth_deg
            Apparent elevation, 0 to 90, and azimuth from the sun [deg], of shapes that broadcast.

        Returns
        -------
        (..., V)
            Radiance over the solar irradiance [sr^-1].

        Raises
        ------
        CompactSkyError
            For a direction below the horizon.
        """
        e, a = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        _check_directions(e, a)
        flat_e, flat_a = e.ravel(), a.ravel()
        out = np.empty((flat_e.size, self.dark.shape[1]))
        for start in range(0, flat_e.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            index, value = self.grid.splines(self.sun_elevation_deg, flat_e[part], flat_a[part])
            out[part] = np.exp(_sums(index, value, self.dark))
            if self.ground is not None:
                out[part] += self.ground_weight * np.exp(_sums(index, value, self.ground))
        return out.reshape(*e.shape, -1)

    def on_grid(self, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] (E, A, V) on a grid of elevations (E,) and azimuths (A,) [deg].

        The same as `radiance` in these directions, several times faster, with the same errors.
        """
        e, a = (np.atleast_1d(np.asarray(angle, float)) for angle in (elevation_deg, azimuth_deg))
        _check_directions(e, a)
        out = np.exp(self.grid.on_rows_and_columns(self.sun_elevation_deg, e, a, self.dark))
        if self.ground is not None:
            added = self.grid.on_rows_and_columns(self.sun_elevation_deg, e, a, self.ground)
            out += self.ground_weight * np.exp(added, out=added)
        return out


def _check_size(path: str | os.PathLike) -> None:
    """Raise CompactSkyError, before memory is taken, where the arrays are larger than those of any model."""
    with ZipFile(path) as archive:
        for member in archive.infolist():
            with archive.open(member) as stream:
                first = np.lib.format.read_magic(stream) == (1, 0)
                read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(stream)
            n_bytes = float(np.prod([float(n) for n in shape])) * dtype.itemsize
            if max(n_bytes, member.file_size) > LARGEST_ARRAY_BYTES:
                raise CompactSkyError(
                    f"{path}: says that {member.filename} has {max(n_bytes, member.file_size):.3g} bytes; a compact "
                    f"sky's arrays have at most {LARGEST_ARRAY_BYTES:.3g}"
                )


def _sums(index: np.ndarray, value: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """sum over the 20 splines of value (20, D) times coefficients[index] (K, V): (D, V)."""
    out = np.zeros((index.shape[1], coefficients.shape[1]))
    for rows, weight in zip(index, value, strict=True):
        out += weight[:, None] * coefficients[rows]
    return out


def _check_directions(elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> None:
    _check_range("elevation_deg", elevation_deg, 0.0, 90.0, " deg")
    if not np.isfinite(azimuth_deg).all():
        raise CompactSkyError("azimuth_deg must be finite")


def _check_range(name: str, values: np.ndarray, low: float, high: float, unit: str) -> None:
    if not (values >= low).all() or not (values <= high).all():
        wrong = values[~((values >= low) & (values <= high))].flat[0] if values.ndim else float(values)
        raise CompactSkyError(f"{name} is {wrong:g}; allowed is {low:g} to {high:g}{unit}")
