"""Directions of the field, the harmonics that describe light in them, and nodes of the solar zenith angle.

Directions are in the local frame of a node: cosine of the zenith angle, azimuth from the sun.  The field is its own
mirror image about the sun's vertical: azimuths go from 0 to 180 deg and harmonics are even in azimuth.

Linear polarisation is in spin-2 harmonics (E and B).  In every direction of view, with v the unit vector that is normal
to it and points up and h the horizontal unit vector to the right, light is the tensor
I/2 (vv + hh) + Q/2 (vv - hh) + U/2 (vh + hv).  A field that is its own mirror image about the sun's vertical is
    I = sum I_lm Y_lm cos(m a),
    Q = sum (E_lm X_lm + B_lm Z_lm) cos(m a),      U = sum (E_lm Z_lm + B_lm X_lm) sin(m a),      l >= 2,
with the azimuth a from the sun, positive to the right, and polar parts of a mean square of 1 over the sphere:
    Y_lm = N d^l_m0,   X_lm = N (d^l_m2 + d^l_m,-2)/2,   Z_lm = N (d^l_m2 - d^l_m,-2)/2,   N^2 = (2l + 1)(1 or 2),
where d^l_mn are Wigner's functions of the zenith angle (generalised spherical functions).  Scattering by
particles that lie at random keeps l and m, and does not mix what a mirror leaves (I, E) with what it turns round (B):
    I' = chi_l I + b_l E,      E' = b_l I + even_l E,      B' = odd_l B,
with the moments b, even and odd of the phase matrix (`twilight.transport.scaling`).
Air has only b_2 = -3 Delta/(5 sqrt 6) and even_2 = 3 Delta/5: it sees the traceless tensor of the field, five numbers.
Reference: Hovenier, van der Mee & Domke 2004, Transfer of Polarized Light in Planetary Atmospheres, appendix B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import DARK
from twilight.solvers.zones import constants as tuned
from twilight.transport.scaling import wigner_d


@dataclass(frozen=True)
class Angles:
    """Directions of every node altitude and the harmonics that describe Stokes parameters there.

    cosine (Z, M) of the zenith angle, azimuth (F,) [rad], weight (Z, M): of a polar angle over the sphere, sum 1
    below: number of the M polar angles below the horizon, which come before the others
    degree, order (C,): of each harmonic of I, sorted by azimuthal order; the mean square of a harmonic is 1
    spin2_degree, spin2_order (C',): of the spin-2 harmonics of Q and U; none without polarisation
    taper (C,): weight of each harmonic of I in the truncated series, 1 but for the last (`FractionalTruncation`)
    analysis (Z, C, M, F): moments of I from radiances, by quadrature, before that weight
    spin2_analysis (Z, 2 C', 2, M, F): the same for the moments E, then B, from Q and U
    """

    cosine: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray
    below: int
    degree: np.ndarray
    order: np.ndarray
    spin2_degree: np.ndarray
    spin2_order: np.ndarray
    taper: np.ndarray
    analysis: np.ndarray
    spin2_analysis: np.ndarray

    @property
    def series(self) -> Truncation:
        return Truncation(
            int(self.degree.max()),
            int(self.order.max()) + 1,
            int(self.spin2_degree.max(initial=0)),
            int(self.spin2_order.max(initial=-1)) + 1,
        )

    @property
    def n_moments(self) -> int:
        return self.degree.size + 2 * self.spin2_degree.size

    def shared_with(self, smaller: Angles) -> np.ndarray:
        """Indices of the moments that a smaller set has too, in the sequence of that set."""
        of_i = (self.degree <= smaller.degree.max()) & (self.order <= smaller.order.max())
        of_qu = (self.spin2_degree <= smaller.spin2_degree.max(initial=0)) & (
            self.spin2_order <= smaller.spin2_order.max(initial=-1)
        )
        return np.flatnonzero(np.concatenate([of_i, of_qu, of_qu]))


class Truncation(NamedTuple):
    """Largest degree and number of azimuthal orders of the harmonics of I, then of the spin-2 harmonics of Q and U, 0
    for none."""

    degree: int
    azimuthal_orders: int
    spin2_degree: int
    spin2_orders: int

    @staticmethod
    def of(degree: int, spin2_degree: int, around: int) -> Truncation:
        """Equal azimuths cannot tell orders from `around` on."""
        n = min(spin2_degree, degree)
        return Truncation(degree, min(degree, around - 1) + 1, n, min(n, around - 1) + 1 if n else 0)


def make_angles(
    horizon_cosine: np.ndarray,
    per_side: int,
    around: int,
    degree: int,
    spin2_degree: int = 0,
    rim_cosine: np.ndarray | None = None,
) -> Angles:
    """`per_side` polar angles above and seven tenths as many below the horizon of each altitude, times `around`
    azimuths.

    horizon_cosine (Z,): of the zenith angle of the geometric horizon, 0 on the ground and negative above it.
    spin2_degree: of the spin-2 harmonics of Q and U, 0 for none.
    rim_cosine (Z,): of the zenith angle of a rim of haze, at which angles part too, NaN where there is none.
    """
    series = Truncation.of(degree, spin2_degree, around)
    n_below = max(7 * per_side // 10, 2)
    cosine = np.empty((horizon_cosine.size, per_side + n_below))
    weight = np.empty_like(cosine)
    for k, h in enumerate(horizon_cosine):
        below, w_below = _clustered(-1.0, h, h, tuned.HORIZON_WIDTH, n_below)
        above, w_above = _above_horizon(h, np.nan if rim_cosine is None else rim_cosine[k], per_side)
        cosine[k] = np.concatenate([below, above])
        weight[k] = 0.5 * np.concatenate([w_below, w_above])
    azimuth = (np.arange(around) + 0.5) * np.pi / around
    highest = series.azimuthal_orders - 1
    order = np.array([m for m in range(highest + 1) for _ in range(m, degree + 1)])
    deg = np.array([n for m in range(highest + 1) for n in range(m, degree + 1)])
    spin2_deg, spin2_order = spin2_degrees_and_orders(series.spin2_degree, series.spin2_orders - 1)
    cosines = np.cos(spin2_order[:, None] * azimuth)[:, None, :]
    sines = np.sin(spin2_order[:, None] * azimuth)[:, None, :]
    spin2_analysis = []
    amplitudes = np.cos(order[:, None] * azimuth)
    rows = analysis_rows(cosine, weight, horizon_cosine, n_below, deg, order)
    analysis = rows[..., None] * amplitudes[:, None, :] / around
    for mu, fraction in zip(cosine, weight, strict=True):
        x, z = (part.T[:, :, None] for part in spin2_harmonics(mu, series.spin2_degree, series.spin2_orders - 1))
        of_q = np.concatenate([x * cosines, z * cosines])
        of_u = np.concatenate([z * sines, x * sines])
        spin2_analysis.append(np.stack([of_q, of_u], axis=1) * (fraction / around)[:, None])
    return Angles(
        cosine,
        azimuth,
        weight,
        n_below,
        deg,
        order,
        spin2_deg,
        spin2_order,
        np.ones(order.size),
        analysis,
        np.array(spin2_analysis),
    )


def _above_horizon(horizon: float, rim: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines of n polar angles above a horizon and their weights, parted at a rim of haze if there is one.

    Light jumps at the rim: quadratures across it, of 14 angles, were wrong by up to 13 % of the mean light 10 km up in
    deep twilight, and each number of angles in another way.
    """
    n_below = min(tuned.BELOW_RIM, n // 3)
    if np.isnan(rim) or n_below == 0:
        return _clustered(horizon, 1.0, tuned.CENTRE_FRACTION * horizon, tuned.HORIZON_WIDTH, n)
    below, weight_below = _clustered(horizon, rim, rim, 1.0, n_below)
    above, weight_above = _clustered(rim, 1.0, tuned.CENTRE_FRACTION * rim, tuned.RIM_WIDTH, n - n_below)
    return np.concatenate([below, above]), np.concatenate([weight_below, weight_above])


def analysis_rows(
    cosine: np.ndarray, weight: np.ndarray, horizon: np.ndarray, below: int, degree: np.ndarray, order: np.ndarray
) -> np.ndarray:
    """Rows (Z, C, M) that find harmonics in light at M polar angles, exact for light smooth beside the horizon.

    Polar angles that crowd at the horizon are missing elsewhere.  Weights alone, 14 of them find up to 7 % of light
    that is the same all over the hemisphere in a harmonic of degree 20, and a phase function with a strong forward peak
    loses 6 to 9 % of what it should scatter into the zenith.  So above and below the horizon, for each order m, a
    polynomial in the cosine times sin^m is fitted to the light, by angles away from the horizon, and integrated in
    closed form; the weights sum what is left.  A glow at the horizon is in that rest: it is summed as by weights alone.

    cosine, weight (Z, M): over the sphere; horizon (Z,): its cosine; below: how many of the angles are below it;
    degree, order (C,): sorted by order
    """
    highest = int(order.max())
    rows = np.ascontiguousarray((even_harmonics(cosine, int(degree.max()), highest) * weight[..., None]).swapaxes(1, 2))
    x, w = np.polynomial.legendre.leggauss(int(degree.max()) + 4)
    edge = horizon[:, None]
    for part, low, high in ((slice(0, below), -1.0, edge), (slice(below, None), edge, 1.0)):
        mu = cosine[:, part]
        n = min(tuned.MAX_FITTED_TERMS, mu.shape[1] // 3)
        if n == 0:
            continue
        away = (mu - edge) ** 2
        trust = (weight[:, part] * (away / (away + tuned.AWAY_COSINE**2)) ** 3)[..., None]
        inner = 0.5 * (low + high) + 0.5 * (high - low) * x
        harmonics = even_harmonics(inner, int(degree.max()), highest) * (0.25 * (high - low) * w)[..., None]
        powers = np.polynomial.legendre.legvander((2.0 * mu - low - high) / (high - low), n - 1)
        inner_powers = np.polynomial.legendre.legvander(x, n - 1)
        for m in range(highest + 1):
            of = order == m
            fit = powers * (1.0 - mu**2)[..., None] ** (0.5 * m)
            inner_fit = inner_powers * (1.0 - inner**2)[..., None] ** (0.5 * m)
            truth = harmonics[..., of].swapaxes(1, 2) @ inner_fit
            trusted = (fit * trust).swapaxes(1, 2)
            by_weights = rows[:, of, part]
            rows[:, of, part] = by_weights + (truth - by_weights @ fit) @ np.linalg.solve(trusted @ fit, trusted)
    return rows


def conserving_angles(angles: Angles) -> Angles:
    """The same directions, with an analysis that is exact for light of degree LOW_DEGREE and less.

    In thick air of conservative scattering light is nearly isotropic, and a scattering that loses one part in a
    thousand of it, or moves it to one side, changes all that is left after thousands.  Above and below the horizon
    weights change by the least fraction that makes parabolas exact, and what light has of low degrees is taken out
    before higher degrees are looked for: few directions would see some in light that has none.  For light that is
    brightest at the horizon the quadrature by weights alone is the better one.
    """
    around = angles.azimuth.size
    low = angles.degree <= tuned.LOW_DEGREE
    weights, analysis = angles.weight.copy(), []
    horizons = 2.0 * weights[:, : angles.below].sum(axis=1) - 1.0
    for mu, weight, horizon in zip(angles.cosine, weights, horizons, strict=True):
        for part, a, b in ((slice(0, angles.below), -1.0, horizon), (slice(angles.below, None), horizon, 1.0)):
            w = weight[part]
            k = np.arange(min(tuned.LOW_DEGREE + 1, w.size))
            basis = np.polynomial.legendre.legvander((2.0 * mu[part] - a - b) / (b - a), k.size - 1).T
            exact = np.where(k == 0, 0.5 * (b - a), 0.0)
            w *= 1.0 + np.linalg.solve((basis * w) @ basis.T, exact - basis @ w) @ basis
    polar = analysis_rows(angles.cosine, weights, horizons, angles.below, angles.degree, angles.order)
    amplitudes = np.cos(angles.order[:, None] * angles.azimuth)
    for mu, of_polar in zip(angles.cosine, polar, strict=True):
        polar_parts = even_harmonics(mu, int(angles.degree.max()), int(angles.order.max()))
        basis = (polar_parts[:, None, :] * amplitudes.T[None]).reshape(-1, angles.order.size)
        rows = (of_polar[..., None] * amplitudes[:, None, :] / around).reshape(angles.order.size, -1)
        rows[low] = np.linalg.solve(rows[low] @ basis[:, low], rows[low])
        rows[~low] -= (rows[~low] @ basis[:, low]) @ rows[low]
        analysis.append(rows.reshape(angles.order.size, mu.size, around))
    return replace(angles, weight=weights, analysis=np.array(analysis))


def _clustered(low: float, high: float, centre: float, width: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on low..high, close together around `centre`: uniform in asinh((x - centre)/width)."""
    x, w = np.polynomial.legendre.leggauss(n)
    a, b = np.arcsinh((low - centre) / width), np.arcsinh((high - centre) / width)
    t = a + (b - a) * 0.5 * (x + 1.0)
    w = w * np.cosh(t)
    return centre + width * np.sinh(t), w * ((high - low) / w.sum())


def even_harmonics(cosine: np.ndarray, degree: int, highest: int) -> np.ndarray:
    """Polar parts (P, C) of the harmonics P_lm(cosine) cos(m azimuth), mean square 1 over the sphere.

    Sorted by m = 0..highest.
    """
    x = np.asarray(cosine, dtype=float)
    s = np.sqrt(np.maximum(0.0, 1.0 - x * x))
    columns = []
    diagonal = np.ones_like(x)
    for m in range(highest + 1):
        if m > 0:
            diagonal = diagonal * s * np.sqrt((2.0 * m + 1.0) / (2.0 * m))
        factor = 1.0 if m == 0 else np.sqrt(2.0)
        before, current = np.zeros_like(x), diagonal
        columns.append(factor * current)
        for n in range(m + 1, degree + 1):
            a = np.sqrt((4.0 * n * n - 1.0) / (n * n - m * m))
            b = np.sqrt(((n - 1.0) ** 2 - m * m) / (4.0 * (n - 1.0) ** 2 - 1.0))
            before, current = current, a * (x * current - b * before)
            columns.append(factor * current)
    return np.stack(columns, axis=-1)


def zenith_nodes(first_deg: float, last_deg: float, density: float) -> np.ndarray:
    """Solar zenith angles [deg] from first_deg or less to last_deg or more, close together within TWILIGHT_DEG."""
    out = [0.0]
    begin, end = tuned.TWILIGHT_DEG
    while out[-1] < 180.0:
        x = out[-1]
        if x < begin:
            step = min(tuned.MAX_DAY_STEP_DEG, tuned.TWILIGHT_STEP_DEG + tuned.DAY_STEP_GROWTH * (begin - x))
        elif x < end:
            step = tuned.TWILIGHT_STEP_DEG
        else:
            step = min(tuned.MAX_NIGHT_STEP_DEG, tuned.TWILIGHT_STEP_DEG + tuned.NIGHT_STEP_GROWTH * (x - end))
        out.append(x + step / density)
    nodes = np.array(out)
    first = max(0, int(np.searchsorted(nodes, first_deg, side="right")) - 1)
    last = min(nodes.size - 1, max(first + tuned.MIN_ZENITH_INTERVALS, int(np.searchsorted(nodes, last_deg))))
    return nodes[first : last + 1]


def cubic_refinement(
    coarse: np.ndarray, per_interval: int, breaks: np.ndarray | tuple = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A grid with `per_interval` steps in every interval of `coarse`, and cubic interpolation to it.

    Interpolation never looks across one of the `breaks`, nodes at which the values bend.
    Returns (fine (n,), node (n, 4), weight (n, 4)): value = sum_j weight[j] coarse_value[node[j]].
    """
    t = np.arange(per_interval) / per_interval
    fine = np.append((coarse[:-1, None] + np.diff(coarse)[:, None] * t[None]).ravel(), coarse[-1])
    interval = np.clip(np.searchsorted(coarse, fine, side="right") - 1, 0, coarse.size - 2)
    ends = np.unique([0, *np.flatnonzero(np.isin(coarse, breaks)), coarse.size - 1])
    piece = np.clip(np.searchsorted(ends, interval, side="right") - 1, 0, ends.size - 2)
    low, high = ends[piece], ends[piece + 1]
    width = np.minimum(4, high - low + 1)
    first = np.clip(interval - 1, low, high + 1 - width)
    node = np.minimum(first[:, None] + np.arange(4), coarse.size - 1)
    weight = np.zeros((fine.size, 4))
    for j in range(4):
        w = np.where(j < width, 1.0, 0.0)
        for k in range(4):
            if k != j:
                used = (j < width) & (k < width)
                gap = np.where(used, coarse[node[:, j]] - coarse[node[:, k]], 1.0)
                w *= np.where(used, (fine - coarse[node[:, k]]) / gap, 1.0)
        weight[:, j] = w
    return fine, node, weight


def spin2_harmonics(cosine: np.ndarray, degree: int, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Polar parts X and Z (P, C) at cosines (P,), sorted by m = 0..highest and within by l = max(m, 2)..degree."""
    x = np.asarray(cosine, dtype=float)
    polar_x, polar_z = [np.zeros((0, x.size))], [np.zeros((0, x.size))]
    for m in range(highest + 1):
        first = max(m, 2)
        right, left = wigner_d(degree, m, 2, x)[first:], wigner_d(degree, m, -2, x)[first:]
        # the harmonics of the intensity are taken with positive P_mm, Wigner's functions are not
        norm = 0.5 * (-1.0) ** m * np.sqrt((2.0 * np.arange(first, degree + 1) + 1.0) * (2.0 if m else 1.0))[:, None]
        polar_x.append(norm * (right + left))
        polar_z.append(norm * (right - left))
    return np.concatenate(polar_x).T, np.concatenate(polar_z).T


def spin2_degrees_and_orders(degree: int, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Degrees and orders (C,) of the spin-2 harmonics, in the sequence of `spin2_harmonics`."""
    pairs = [(n, m) for m in range(highest + 1) for n in range(max(m, 2), degree + 1)]
    return np.array([n for n, _ in pairs], dtype=int), np.array([m for _, m in pairs], dtype=int)


def scattering_geometry(
    cosine: np.ndarray, cos_azimuth: np.ndarray, sin_azimuth: np.ndarray, sun_zenith_rad: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(cosine of the scattering angle, cos 2 sigma, sin 2 sigma) of sunlight scattered towards the observer.

    cosine: of the zenith angles of the directions of view; azimuths from the sun; sigma: from the vertical plane,
        clockwise, to the plane through line of sight and sun.  Towards the sun itself there is no such plane: there
        both are 0, as P12 is.
    """
    mu = cosine
    sine = np.sqrt(np.maximum(0.0, 1.0 - mu * mu))
    up, aside = np.cos(sun_zenith_rad), np.sin(sun_zenith_rad)
    along = mu * up + sine * aside * cos_azimuth
    of_v = sine * up - mu * aside * cos_azimuth
    of_h = -aside * sin_azimuth
    square = of_v * of_v + of_h * of_h
    safe = np.where(square > DARK, square, 1.0)
    lit = square > DARK
    return along, np.where(lit, (of_v * of_v - of_h * of_h) / safe, 0.0), np.where(lit, 2.0 * of_v * of_h / safe, 0.0)
