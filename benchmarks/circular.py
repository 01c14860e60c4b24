"""How large circular polarisation is, and what leaving it out does to I, Q and U.

    python benchmarks/circular.py      writes circular.csv

A Monte-Carlo of its own with 4 x 4 phase matrices: one layer, as thick as the climate's air and aerosol together and
mixed alike at all heights, flat, over a black ground; sunlight unpolarised.  Every path carries two matrices, one with
P34 and one with circular polarisation left out, so that their difference is known better than either.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import results
from numba import njit

from twilight.config.load import load_climate
from twilight.numerics.phase import RATIO_P34, table_angles_rad
from twilight.scene.medium import climate_medium

CLIMATES = ("continental-average", "urban", "desert", "volcanic-extreme")
WAVELENGTHS_NM = (450.0, 650.0)
SUNS_DEG = (30.0, 5.0)
DIRECTIONS_DEG = tuple((e, a) for e in (10.0, 30.0, 60.0) for a in (45.0, 90.0, 135.0))
PATHS = 20_000
MOST_EVENTS = 40
NODES = 4001


def mixture(medium, w: int) -> tuple[float, float, np.ndarray]:
    """Optical depth, single scattering albedo and elements (5, NODES) P11, P12, P22, P33, P34 of the column."""
    z = medium.altitude_km
    cosine = np.cos(np.linspace(0.0, np.pi, NODES))

    def depth(per_km):
        return float(np.trapezoid(per_km, z))

    air = depth(medium.air_scattering_per_km[:, w])
    delta = (1.0 - medium.depolarisation[w]) / (1.0 + 0.5 * medium.depolarisation[w])
    part = 0.75 * delta / (4.0 * np.pi)
    p22 = part * (1.0 + cosine**2)
    rows = air * np.array(
        [p22 + (1 - delta) / (4 * np.pi), -part * (1 - cosine**2), p22, 2 * part * cosine, 0 * cosine]
    )
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    total = air
    for phase, share in zip(medium.phase_functions, medium.aerosol_phase_fraction, strict=True):
        amount = depth((scattering * share)[:, w])
        elements = phase.matrix(cosine)[:, w]
        p34 = np.interp(np.arccos(cosine), table_angles_rad(phase.log_table.shape[1]), phase.ratios[RATIO_P34, w])
        rows += amount * np.concatenate([elements, (elements[0] * p34)[None]])
        total += amount
    whole = depth(medium.extinction_per_km[:, w])
    return whole, total / whole, rows / total


@njit(cache=True)
def element(rows, cosine):
    """(P11, P12, P22, P33, P34) at the cosine of a scattering angle."""
    x = math.acos(min(1.0, max(-1.0, cosine))) / math.pi * (rows.shape[1] - 1)
    i = min(int(x), rows.shape[1] - 2)
    f = x - i
    out = np.empty(5)
    for k in range(5):
        out[k] = rows[k, i] * (1.0 - f) + rows[k, i + 1] * f
    return out


@njit(cache=True)
def after(matrix, frame, new, p, circular):
    """The product with rotation and phase matrix (4, 4) after a turn from frame[0] to new; with V or without."""
    a = frame[1] @ new
    b = frame[2] @ new
    h = a * a + b * b
    c, s = (1.0, 0.0) if h < 1e-28 else ((a * a - b * b) / h, 2.0 * a * b / h)
    v = p[4] if circular else 0.0
    out = np.empty((4, 4))
    for k in range(4):
        i, q, u, w = matrix[k]
        along, across = q * c + u * s, u * c - q * s
        out[k, 0] = i * p[0] + along * p[1]
        out[k, 1] = i * p[1] + along * p[2]
        out[k, 2] = across * p[3] - w * v
        out[k, 3] = across * v + w * p[3]
    return out


@njit(cache=True)
def turned(frame, new):
    """Frame (direction, reference in the scattering plane, third) of the leg after."""
    out = np.empty((3, 3))
    out[0] = new
    e = (frame[0] @ new) * new - frame[0]
    if e @ e < 1e-20:
        e = frame[1] - (frame[1] @ new) * new
    out[1] = e / math.sqrt(e @ e)
    out[2] = np.cross(out[1], new)
    return out


@njit(cache=True)
def walk(depth, albedo, rows, cdf, start, sun, paths, generator, sums, squares):
    """Sums (2, 4) of I, Q, U, V with circular polarisation and without, and of the squares of (V, differences) (4,)."""
    one = np.empty((2, 4))
    for _ in range(paths):
        one[:] = 0.0
        frame = start.copy()
        matrices = np.zeros((2, 4, 4))
        for k in range(4):
            matrices[:, k, k] = 1.0
        t, weight = 0.0, 1.0
        for _event in range(MOST_EVENTS):
            up = frame[0, 2]
            longest = (depth - t) / up if up > 0.0 else t / max(-up, 1e-9)
            inside = -math.expm1(-longest)
            if inside <= 0.0:
                break
            t = min(depth, max(0.0, t - up * math.log1p(-generator.random() * inside)))
            weight *= inside * albedo
            reach = math.exp(-(depth - t) / sun[2])
            p = element(rows, frame[0] @ sun)
            for k in range(2):
                one[k] += weight * reach * after(matrices[k], frame, sun, p, k == 0)[:, 0]
            j = np.searchsorted(cdf, generator.random())
            angle = math.pi * (j + generator.random() - 1.0) / (cdf.size - 1)
            angle = min(math.pi, max(0.0, angle))
            turn = 2.0 * math.pi * generator.random()
            new = math.cos(angle) * frame[0] + math.sin(angle) * (math.cos(turn) * frame[1] + math.sin(turn) * frame[2])
            new /= math.sqrt(new @ new)
            p = element(rows, frame[0] @ new)
            for k in range(2):
                matrices[k] = after(matrices[k], frame, new, p / p[0], k == 0)
            frame = turned(frame, new)
            if weight < 1e-3:
                if generator.random() > 0.1:
                    break
                weight *= 10.0
        sums += one
        squares[0] += one[0, 3] ** 2
        for k in range(3):
            squares[1 + k] += (one[0, k] - one[1, k]) ** 2


def main() -> None:
    table = []
    for climate in CLIMATES:
        medium = climate_medium(load_climate(climate), np.array(WAVELENGTHS_NM))
        for w, nm in enumerate(WAVELENGTHS_NM):
            depth, albedo, rows = mixture(medium, w)
            sine = np.sin(np.linspace(0.0, np.pi, NODES))
            cdf = np.concatenate([[0.0], np.cumsum(0.5 * (rows[0] * sine)[1:] + 0.5 * (rows[0] * sine)[:-1])])
            cdf /= cdf[-1]
            for sun_deg in SUNS_DEG:
                s = math.radians(sun_deg)
                sun = np.array([math.cos(s), 0.0, math.sin(s)])
                found, noise = [], []
                for n, (e, a) in enumerate(np.radians(DIRECTIONS_DEG)):
                    d = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
                    v = np.array([-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e)])
                    sums, squares = np.zeros((2, 4)), np.zeros(4)
                    walk(
                        depth,
                        albedo,
                        rows,
                        cdf,
                        np.array([d, v, np.cross(v, d)]),
                        sun,
                        PATHS,
                        np.random.default_rng(n),
                        sums,
                        squares,
                    )
                    i = sums[0, 0]
                    found.append([sums[0, 3] / i, *((sums[0, k] - sums[1, k]) / i for k in range(3))])
                    noise.append(np.sqrt(squares) / i)
                size, error = np.abs(found).max(axis=0), np.median(noise, axis=0)
                numbers = [size[0], error[0], size[1], error[1], size[2:].max(), error[2:].max()]
                table.append([climate, f"{nm:g}", f"{sun_deg:g}", *(f"{x:.1e}" for x in numbers)])
                print(*table[-1], sep="\t", flush=True)
    columns = [
        "climate",
        "wavelength_nm",
        "sun_elevation_deg",
        "v_over_i",
        "v_noise",
        "change_of_i",
        "i_noise",
        "change_of_q_u",
        "q_u_noise",
    ]
    notes = ["largest over nine directions, all over I; changes are those of leaving circular polarisation out"]
    results.write(Path(__file__).parent / "circular.csv", columns, table, notes=notes)


if __name__ == "__main__":
    main()
