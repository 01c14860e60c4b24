"""Haber section 4.4: the refracted path from a cell to the sun, by Snell's law from layer to layer and a binary search.

Each layer has one index n.  On a path n r sin(i) = p, so that within layer i it is the straight line that passes the
Earth's centre at p/n_i, and at a boundary of radius r between a lower layer (t_l = r cos i there) and an upper one
    sin(deflection) = (p/n_u t_l - p/n_l t_u) / r^2,
always towards the Earth.  A ray that leaves the cell theta above the sun and is deflected by delta in all leaves the
air theta - delta above the sun.  That rises with theta: his search halves the range of 0 to 2 deg until it is within
the tolerance.  A ray that meets the ground was too low; where the search ends at such rays after MAX_STEPS the cell is
in the Earth's shadow.  Layers make delta jump by 2 sqrt(2 (n_l - n_u)) where the ray begins to dip into the next one
(0.4 deg with 50 layers): where the search ends at a jump the ray above it is taken.  A ray that a boundary would
reflect totally goes on along it, as in air without steps.

Section 4.6.2, first scattering event: the sunlight that every cell scatters, of air and of aerosol apart.  Eq. (5)
with the sun as the source, A instead of omega / 4 pi:

    I_air = E (tau_front - tau_back) sigma_air / sigma_e A,   I_aerosol likewise,

tau by eq. (4) along the refracted path, times the ozone filter exp(-alpha d) of section 4.3, which is crossed
vertically.  A cell whose path meets the ground lies in the Earth's shadow.
"""

import math

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.exchange import Rings, chord_of
from twilight.solvers.cells.grid import Layers

LARGEST_LIFT_RAD = math.radians(2.0)
"""theta_high: "in practice, this angle is always smaller than 2 degrees" [rad]."""
MAX_STEPS = 20
"""Most halvings, to 2 millionths of a degree; he needs 5 to 15."""


@njit(cache=True, makes_arrays=False)
def _square(layers, w, i, ground, sine, cosine, own):
    """a at which the straight line of layer i is nearest to the Earth's centre [km^2].

    layers: `Layers`; w: index of the wavelength; ground [km^2]: a of the start; sine, cosine: of the elevation there;
    own: refractive index there.
    """
    ratio = own / (1.0 + layers.refractivity[i, w])
    radius2 = layers.earth_radius_km * layers.earth_radius_km + ground
    return ground - radius2 * (sine * sine + cosine * cosine * (1.0 - ratio) * (1.0 + ratio))


@njit(cache=True, makes_arrays=False)
def trace_to_space(layers, w, altitude_km, layer, elevation):
    """(deflection [rad], optical depth) of a ray at one wavelength from inside the air; deflection nan where it does
    not leave it.

    layers: `Layers`; w: index of the wavelength; altitude_km, layer: of the start; elevation [rad]: of the ray there.
    """
    square = layers.square_km2
    n_layers = square.size - 1
    earth2 = layers.earth_radius_km * layers.earth_radius_km
    start = altitude_km * (2.0 * layers.earth_radius_km + altitude_km)
    sine, cosine = math.sin(elevation), abs(math.cos(elevation))
    own = 1.0 + layers.refractivity[layer, w]
    p = math.sqrt(earth2 + start) * cosine * own
    deflection, depth = 0.0, 0.0
    k = layer
    lowest = _square(layers, w, k, start, sine, cosine, own)
    at = math.sqrt(max(start - lowest, 0.0))
    if sine < 0.0:  # down to the lowest point
        while square[k] > lowest:
            end = math.sqrt(square[k] - lowest)
            depth += layers.extinction[k, w] * (at - end)
            if k == 0:
                return math.nan, 0.0
            below = _square(layers, w, k - 1, start, sine, cosine, own)
            at = math.sqrt(max(square[k] - below, 0.0))
            upper, lower = p / (1.0 + layers.refractivity[k, w]), p / (1.0 + layers.refractivity[k - 1, w])
            deflection += math.asin((upper * at - lower * end) / (earth2 + square[k]))
            lowest = below
            k -= 1
        depth += layers.extinction[k, w] * at
        at = 0.0
        if k == 0 and square[0] > lowest:
            return math.nan, 0.0
    while True:  # and up
        end = math.sqrt(max(square[k + 1] - lowest, 0.0))
        depth += layers.extinction[k, w] * max(end - at, 0.0)
        radius2 = earth2 + square[k + 1]
        lower = p / (1.0 + layers.refractivity[k, w])
        if k + 1 == n_layers:
            out = math.sqrt(max(radius2 - p * p, 0.0))
            return deflection + math.asin((min(p, math.sqrt(radius2)) * end - lower * out) / radius2), depth
        above = _square(layers, w, k + 1, start, sine, cosine, own)
        k += 1
        if square[k] < above:  # totally reflected: in air without steps it would go on
            start, sine, cosine, own = square[k], 0.0, 1.0, 1.0 + layers.refractivity[k, w]
            p = math.sqrt(radius2) * own
            deflection += math.asin(end / math.sqrt(radius2))
            lowest, at = start, 0.0
            continue
        at = math.sqrt(square[k] - above)
        upper = p / (1.0 + layers.refractivity[k, w])
        deflection += math.asin((upper * end - lower * at) / radius2)
        lowest = above


@njit(cache=True, makes_arrays=False)
def find_sun(layers, w, altitude_km, layer, sun_elevation, tolerance):
    """(lift theta [rad], optical depth, steps) of the ray from a cell to the sun; lift nan in the Earth's shadow.

    layers: `Layers`; w: index of the wavelength; altitude_km, layer: of the cell; sun_elevation [rad]: true one, over
    the horizontal plane of the cell; tolerance [rad]: of the direction in which the ray leaves the air, 0 where the
    layers have no refractivity.
    """
    if tolerance == 0.0:  # straight rays
        deflection, depth = trace_to_space(layers, w, altitude_km, layer, sun_elevation)
        return deflection, depth, 1
    low, high = 0.0, LARGEST_LIFT_RAD
    low_leaves = False
    for step in range(1, MAX_STEPS + 1):
        lift = 0.5 * (low + high)
        deflection, depth = trace_to_space(layers, w, altitude_km, layer, sun_elevation + lift)
        if abs(lift - deflection) < tolerance:
            return lift, depth, step
        if lift > deflection:
            high = lift
        else:  # too low, or nan: it meets the ground
            low, low_leaves = lift, not math.isnan(deflection)
    deflection, depth = trace_to_space(layers, w, altitude_km, layer, sun_elevation + high)
    return high if low_leaves else math.nan, depth, MAX_STEPS


def refracted_sun(
    layers, altitude_km: np.ndarray, layer: np.ndarray, sun_elevation: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`find_sun` of many cells (D,) at all wavelengths: lift [rad], optical depth and steps, (D, W)."""
    found = [
        [find_sun(layers, w, z, i, e, tolerance) for w in range(layers.air.shape[1])]
        for z, i, e in zip(altitude_km, layer, sun_elevation, strict=True)
    ]
    lift, depth, steps = np.moveaxis(np.array(found), -1, 0)
    return lift, depth, steps


@njit(cache=True, nogil=True)
def _sunlit(layers, rings, sun, tolerance, air, aerosol, begin, end):
    """Power over F0 [km^2] that the rings begin..end scatter: air, aerosol (G, W, H), filled.

    layers, rings, sun, tolerance: as in `sunlit`.
    """
    n_wavelengths, n_half = air.shape[1], air.shape[2]
    for ring in range(begin, end):
        k = rings.layer[ring]
        x = rings.radius[ring] * rings.cos_elevation[ring]
        z = rings.radius[ring] * rings.sin_elevation[ring] + rings.observer_radius
        rho = math.sqrt(x * x + z * z)
        for j in range(n_half):
            azimuth = math.pi * j / (n_half - 1)
            cosine = (x * math.cos(azimuth) * sun[0] + z * sun[2]) / rho
            elevation = math.asin(max(-1.0, min(1.0, cosine)))
            chord = chord_of(rings, ring, azimuth, sun[0], 0.0, sun[2])
            area = rings.volume[ring] / chord
            for w in range(n_wavelengths):
                lift, depth, _ = find_sun(layers, w, rings.altitude[ring], k, elevation, tolerance)
                extinction = layers.extinction[k, w]
                if math.isnan(lift) or extinction == 0.0:
                    air[ring, w, j] = aerosol[ring, w, j] = 0.0
                    continue
                inside = chord * extinction
                taken = area * math.exp(-max(depth - 0.5 * inside, 0.0)) * -math.expm1(-inside)
                air[ring, w, j] = taken * layers.air[k, w] / extinction
                aerosol[ring, w, j] = taken * layers.aerosol[k, w] / extinction


def sunlit(
    layers: Layers, rings: Rings, sun: np.ndarray, tolerance: float, filtered: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """I_air and I_aerosol (G, W, H) over F0 [km^2] of the cells at the H azimuths of one side.

    sun (3,): unit vector to it; tolerance [rad]: of `find_sun`; filtered (W,): transmittance of the ozone filter.
    """
    shape = (rings.radius.size, layers.air.shape[1], rings.azimuth_cells // 2 + 1)
    air, aerosol = np.empty(shape), np.empty(shape)
    in_slices(lambda begin, end: _sunlit(layers, rings, sun, tolerance, air, aerosol, begin, end), rings.radius.size)
    for light in (air, aerosol):
        light *= filtered[:, None]
    return air, aerosol
