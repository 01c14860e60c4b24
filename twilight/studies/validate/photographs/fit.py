"""How far the skies of an air are from photographs, with what the camera and the solver may have done to them.

A photograph's cells and the computed sky are compared in m = (ln G, ln R/G, ln B/G).  Their difference is

    ln photograph - ln computed = sum_k c_k m_k + e,

where m_k are what a camera does alike to a whole picture: exposure (a constant of ln G, for each picture), white
balance (constants of ln R/G and ln B/G), a tone curve (`photo.Curve`), a lens that darkens its corners; c_k is normally
distributed about 0 with the standard deviations below, wide where nothing is known.  e is what is left: noise of single
cells, what is smooth over a camera's picture (`CAMERA_LN`), errors of the solver, correlated over `SOLVER_DEG` and
between suns, and of the sky itself (haze in streaks, thin cloud, stitching), correlated over `SKY_DEG`, with an
amplitude that the picture itself says (the one of `AMPLITUDES` that makes what is left most likely).
Together they have a covariance C, and

    chi^2 = r^T C^-1 r + sum over what is known before ((value - usual) / its error)^2,

known before being the camera's angles, as told, and ozone and albedo, as usual at the place and in the season, so that
exposure, colours and curve are marginalised exactly; the angles are fitted, and so are the contrasts of a
picture of floats that somebody developed: its ln G, and its ln R/G and ln B/G, differ over the sky 1 + contrast and
1 + saturation times as much as the light's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from twilight.numerics import spectrum
from twilight.numerics.directions import direction
from twilight.studies.validate.photographs.air import SUN, Parameter, Skies, towards
from twilight.studies.validate.photographs.comparison import LEAST_SLOPE, Curve, residual_vector, tone_shapes
from twilight.studies.validate.photographs.picture_sky import Frame, components

NOISE_LN = (0.007, 0.005, 0.005)
"""Standard errors of one cell in ln G, ln R/G, ln B/G: noise, 8 bits, texture."""
SKY_LN = (0.02, 0.01, 0.01)
"""Those of the sky itself, times an amplitude."""
SKY_DEG = 10.0
"""Angle over which they are correlated [deg]."""
CAMERA_LN = (0.02, 0.03, 0.03)
"""Standard errors of what a camera leaves that is smooth over its picture: flat field, colour matrix.  Three panoramas
(`benchmarks/photos.py`): with 0.016 for colours these outweigh brightness, and a sky a third too bright is taken."""
EIGHT_BITS_LN = (0.03, 0.016, 0.016)
"""The same of pictures in 8 bits, whose gains, curve and `INFLATED` stand for the rest."""
CAMERA_DEG = 45.0
"""Angle over which they are correlated [deg]."""
STEPS = (0.2, 0.6, 0.6)
"""Standard errors of luma and chroma by that, in steps; of luma, noise leaves less.  Twice those of one rounding."""
INFLATED = 1.25
"""Factor on all standard errors of pictures in 8 bits, by ten drawn ones that `benchmarks/phone.py` does not judge."""
SERIES_INFLATED = 1.3
"""The same of a series: what is alike in all its pictures counts less than they are.  By three drawn evenings that
`benchmarks/phone.py` does not judge."""
STEP_REACH = 1.0
"""Steps over which these errors are correlated: they are errors of values, alike all along a line of one colour."""
STEP_COMMON = 0.2
"""Part of their variance that is common to all values."""
AMPLITUDES = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Amplitudes of the sky's errors that are tried."""
SOLVER_DEG = 30.0
"""Angle over which the solver's errors are correlated [deg]."""
SOLVER_SUN_DEG = 4.0
"""Difference of suns over which they are [deg]."""
SOLVER_COLOUR = 0.7
"""Its error in ln R/G and ln B/G over that in ln G."""
UNKNOWN_LN = 10.0
"""Standard deviation of an exposure of which nothing is known."""
WHITE_BALANCE_LN = (0.01, 0.25)
"""Standard deviations of ln R/G and ln B/G of a whole picture: as the camera balanced it, and free."""
CONTRAST, SATURATION = 0.15, 0.25
"""Standard errors of the contrasts of brightness and of colour, of a picture of floats whose making is not known: of
clear panoramas (`benchmarks/holdout.py`) that said they were linear they are 0.9 to 1.15 and 0.7 to 1.35."""
CURVE = (0.3, 0.05, 1.0)
"""Standard deviations of g1, g2 and g3: a phone's picture has 0.7 to 1.4 times the contrast of sRGB, and a shoulder."""
LENS_LN = (-0.04, 0.03)
"""Mean and standard deviation of ln G in the corner of a lens's picture whose vignetting is not known: lenses darken
corners, never light them up, and phones undo most of it.  With a mean of 0 a darkening of 6 % turned the camera up by
0.25 deg and made 3 % more haze and 25 DU more ozone."""
REACH = 4.0
"""Standard errors of an angle within which it is sought."""
STRAINED = 3.0
"""Standard errors of an exposure beyond which a fit is at a wrong place."""
STEP = 2e-3
"""Step of the Jacobian's differences, as a fraction of a parameter's range."""
AT_BOUND = 5e-3
"""Distance to a bound, as a fraction of a parameter's range, within which a value counts as at the bound."""
ANGLES = {"heading": "deg", "pitch": "deg", "roll": "deg", "zoom": "%"}
"""Angles by which a camera may have been held otherwise than told, and how much wider it may have seen; units."""
OF_CAMERA = {**ANGLES, "contrast": "1", "saturation": "1"}
"""All that is fitted of a camera, and the units."""


@dataclass(frozen=True)
class Freedom:
    """What besides the air may differ: gains of the colours, a tone curve; whether colours count; standard errors of
    the camera's angles [deg], of the width of its view [%] and of its contrasts, 0: as told."""

    white_balance: bool = False
    curve: bool = False
    with_colour: bool = True
    heading: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    zoom: float = 0.0
    contrast: float = 0.0
    saturation: float = 0.0


class Errors:
    """The covariance of one or more photographs, and what of a difference is the camera's."""

    def __init__(self, frames: Sequence[Frame], freedom: Freedom, solver_error: float, suns_deg: Sequence[float]):
        counts = [frame.elevation_deg.size for frame in frames]
        n = sum(counts)
        self.frame = np.repeat(np.arange(len(frames)), counts)
        coloured = freedom.with_colour and all(frame.colour_known for frame in frames)
        used = [True, coloured, coloured]
        self.used = np.repeat(used, n)
        where = [direction(f.azimuth_deg, f.elevation_deg) for f in frames]
        away = np.degrees(np.arccos(np.clip(np.concatenate(where) @ np.concatenate(where).T, -1.0, 1.0)))
        near, wide = np.exp(-away / SKY_DEG), np.exp(-0.5 * (away / SOLVER_DEG) ** 2)
        smooth = np.exp(-away / CAMERA_DEG)
        same = self.frame[:, None] == self.frame
        near = near * same
        sun = np.asarray(suns_deg, float)[self.frame]
        wide = wide * np.exp(-0.5 * ((sun[:, None] - sun) / SOLVER_SUN_DEG) ** 2)
        solver = 0.5 * solver_error * np.array([1.0, SOLVER_COLOUR, SOLVER_COLOUR])
        eight_bits = any(frame.eight_bits for frame in frames)
        camera = EIGHT_BITS_LN if eight_bits else CAMERA_LN
        several = SERIES_INFLATED if len(frames) > 1 else 1.0
        self.inflation = INFLATED * several if eight_bits else 1.0
        self._fixed, self._sky = np.zeros((3 * n, 3 * n)), np.zeros((3 * n, 3 * n))
        for k in range(3):
            block = slice(k * n, (k + 1) * n)
            smooth_k = solver[k] ** 2 * wide + camera[k] ** 2 * smooth
            self._fixed[block, block] = smooth_k + NOISE_LN[k] ** 2 * np.eye(n)
            self._sky[block, block] = SKY_LN[k] ** 2 * near
        for at, frame in enumerate(frames):
            here = np.flatnonzero(np.tile(self.frame == at, 3))
            for error, (step, value) in zip(STEPS, frame.rounded() if frame.eight_bits else (), strict=False):
                alike = np.exp(-np.abs(value[:, None] - value) / STEP_REACH)
                alike = error**2 * (STEP_COMMON + (1.0 - STEP_COMMON) * alike)
                self._fixed[np.ix_(here, here)] += np.outer(step, step) * np.tile(alike, (3, 3))
        self._modes(frames, freedom, n)
        self.amplitude = 0.0
        self.take(1.0)

    def _modes(self, frames: Sequence[Frame], freedom: Freedom, n: int) -> None:
        modes: list[tuple[str, np.ndarray, float]] = []
        none = np.zeros(n)
        for k, frame in enumerate(frames):
            error = UNKNOWN_LN if frame.log_exposure is None else frame.log_exposure[1]
            modes.append(("exposure", np.concatenate([self.frame == k, none, none]), error))
        for k in (1, 2):
            constant = np.zeros((3, n))
            constant[k] = 1.0
            modes.append(("white balance", constant.ravel(), WHITE_BALANCE_LN[freedom.white_balance]))
        lens = np.concatenate([np.zeros(f.elevation_deg.size) if f.lens is None else f.lens for f in frames])
        if lens.any():
            modes.append(("lens", np.concatenate([lens, none, none]), LENS_LN[1]))
        self.expected = LENS_LN[0] * np.concatenate([lens, none, none])
        shown = np.concatenate([frame.components for frame in frames], axis=1)
        middle = shown.mean(axis=1)
        self.middle, self.middle_colours = float(middle[0]), (float(middle[1]), float(middle[2]))
        if freedom.curve:
            green, red, blue = shown[0], shown[0] + shown[1], shown[0] + shown[2]
            shapes = tone_shapes(np.stack([green, red, blue]) - self.middle, self.middle)
            for (g, r, b), deviation in zip(shapes, CURVE, strict=True):
                modes.append(("curve", np.concatenate([g, r - g, b - g]), deviation))
        self.kinds = [kind for kind, _, _ in modes]
        self.modes = np.stack([mode for _, mode, _ in modes], axis=1)
        self.deviations = np.array([deviation for _, _, deviation in modes])

    def covariance(self, amplitude: float, without: str = "") -> np.ndarray:
        """C of what counts; without: a kind of modes that is taken as known."""
        free = self.inflation * self.deviations * [kind != without for kind in self.kinds]
        modes = self.modes[self.used]
        return self.of_cells(amplitude) + (modes * free**2) @ modes.T

    def of_cells(self, amplitude: float) -> np.ndarray:
        """C of what counts without the modes, which a whole picture shares."""
        return self.inflation**2 * (self._fixed + amplitude**2 * self._sky)[np.ix_(self.used, self.used)]

    def take(self, amplitude: float) -> None:
        """Set the amplitude of the sky's own errors."""
        if amplitude != self.amplitude:
            self.amplitude, self.root = amplitude, np.linalg.cholesky(self.covariance(amplitude))
            self.whitening = solve_triangular(self.root, np.eye(self.root.shape[0]), lower=True)

    def likeliest(self, difference: np.ndarray) -> float:
        """The amplitude that makes a difference (3 n,) most likely."""
        costs = []
        for amplitude in AMPLITUDES:
            root = np.linalg.cholesky(self.covariance(amplitude))
            white = solve_triangular(root, difference[self.used], lower=True)
            costs.append(float(white @ white) + 2.0 * float(np.log(np.diag(root)).sum()))
        return AMPLITUDES[int(np.argmin(costs))]

    def camera(self, difference: np.ndarray) -> np.ndarray:
        """Coefficients of the modes (K,) that a difference (3 n,) most likely holds."""
        white = self.whitening.T @ (self.whitening @ difference[self.used])
        return (self.inflation * self.deviations) ** 2 * (self.modes[self.used].T @ white)


class Fit:
    """Photographs against skies, in parameters scaled to 0..1 within their bounds, and the best."""

    def __init__(self, frames: Sequence[Frame], skies: Skies, freedom: Freedom, errors: Errors | None = None):
        self.frames, self.skies, self.freedom = list(frames), skies, freedom
        suns = [frame.sun_deg for frame in frames if frame.sun_deg is not None]
        middle = float(np.mean(skies.sun_elevations_deg))
        self.errors = errors or Errors(frames, freedom, skies.error, suns or [middle] * len(frames))
        self.shown = np.concatenate([frame.components for frame in frames], axis=1).ravel()
        self.known = np.zeros(self.shown.size)
        known = [0.0 if f.log_exposure is None else f.log_exposure[0] for f in frames]
        self.known[: self.errors.frame.size] = np.array(known)[self.errors.frame]
        self.known -= self.errors.expected
        self.parameters: list[Parameter] = list(skies.design.parameters)
        if not suns:
            ends = skies.sun_elevations_deg
            self.parameters.append(Parameter(SUN, "sun.elevation_deg", "deg", (ends[0], ends[-1])))
        for name, unit in OF_CAMERA.items():
            error = getattr(freedom, name)
            if error > 0.0:
                within = (-REACH * error, REACH * error)
                self.parameters.append(Parameter(name, "", unit, within, usual=(0.0, error)))
        bounds = [p.scaled(np.array([p.nodes[0], p.nodes[-1]])) for p in self.parameters]
        self.low, self.high = np.array(bounds).T
        usual = np.array([p.usual or (0.0, np.inf) for p in self.parameters])
        self.usual = (usual[:, 0] - self.low) / (self.high - self.low)
        self.strength = (self.high - self.low) / usual[:, 1]
        self.angles = np.array([p.name in OF_CAMERA for p in self.parameters])
        self.corrections = [np.zeros((f.elevation_deg.size, 3)) for f in frames]
        self.fixed: list[tuple[np.ndarray, np.ndarray]] = []
        """Where fits with skies of their own began, and how far each moved."""
        self.x, self.chi2, self.jacobian = np.full(self.low.size, 0.5), np.inf, np.zeros((0, 0))

    def values(self, x: np.ndarray | None = None) -> dict[str, float]:
        """The parameters at x; None: at the best."""
        scaled = self.low + (self.x if x is None else x) * (self.high - self.low)
        return {p.name: float(p.value(s)) for p, s in zip(self.parameters, scaled, strict=True)}

    def where(self, frame: Frame, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Elevations and azimuths [deg] of a frame's cells."""
        return frame.turned(*(values.get(name, 0.0) for name in ANGLES))

    def log_xyz(self, x: np.ndarray, corrected: bool = True) -> list[np.ndarray]:
        """ln(XYZ) (n, 3) of the sky at x in the cells of every frame."""
        values = self.values(x)
        of_air = self.skies.of_air(values)
        made = []
        for frame, correction in zip(self.frames, self.corrections, strict=True):
            sun = values[SUN] if frame.sun_deg is None else frame.sun_deg
            sky = towards(self._under(of_air, sun), *self.where(frame, values))
            made.append(sky + correction if corrected else sky)
        return made

    def uneven(self, x: np.ndarray) -> list[np.ndarray]:
        """What the mean over each cell has beyond its middle (n, 3), in ln(XYZ), at x."""
        values, made = self.values(x), []
        of_air = self.skies.of_air(values)
        for frame in self.frames:
            sky = self._under(of_air, values[SUN] if frame.sun_deg is None else frame.sun_deg)
            elevation, azimuth = self.where(frame, values)
            spread = np.asarray(frame.spread_deg, float)
            if not spread.any():
                made.append(np.zeros((elevation.size, 3)))
                continue
            e, a = spread
            of_parts = [towards(sky, elevation + i * e, azimuth + j * a) for i in (-1, 1) for j in (-1, 1)]
            made.append(np.log(np.mean(np.exp(of_parts), axis=0)) - towards(sky, elevation, azimuth))
        return made

    def differences(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """As `difference` (N, 3 n) for many airs and suns, values (N,); the camera's angles as at the best."""
        best, suns = self.values(), self.skies.sun_elevations_deg
        weights = self.skies.design.weights(values)
        sky = []
        for frame, correction in zip(self.frames, self.corrections, strict=True):
            here = self.where(frame, best)
            of_nodes = np.array([[towards(one, *here) for one in node] for node in self.skies.splines])
            sun = values[SUN] if frame.sun_deg is None else np.full(len(weights), frame.sun_deg)
            of_suns = spectrum.hermite_matrix(suns, sun) if suns.size > 1 else np.ones((len(weights), 1))
            both = (weights[:, :, None] * of_suns[:, None, :]).reshape(len(weights), -1)
            log_xyz = (both @ of_nodes.reshape(both.shape[1], -1)).reshape(len(weights), *correction.shape)
            sky.append(components(np.exp(log_xyz + correction), frame.colour_known))
        developed = self._developed(np.moveaxis(np.concatenate(sky, axis=-1), 0, 1), best)
        return self.shown + self.known - developed.reshape(len(weights), -1)

    def _under(self, of_air: np.ndarray, sun: float) -> np.ndarray:
        same = np.flatnonzero(self.skies.sun_elevations_deg == sun)
        return of_air[int(same[0])] if same.size else self.skies.of_sun(of_air, sun)

    def difference(self, x: np.ndarray) -> np.ndarray:
        """ln photograph - ln computed (3 n,), with the exposures that are known."""
        sky = [
            components(np.exp(log_xyz), frame.colour_known)
            for frame, log_xyz in zip(self.frames, self.log_xyz(x), strict=True)
        ]
        return self.shown + self.known - self._developed(np.concatenate(sky, axis=1), self.values(x)).ravel()

    def _developed(self, sky: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """Components (..., 3, n) of computed light with the contrasts of the picture."""
        contrast, saturation = values.get("contrast", 0.0), values.get("saturation", 0.0)
        if contrast == saturation == 0.0:
            return sky
        middle = sky.mean(axis=-1, keepdims=True)
        return np.asarray(
            middle + np.array([[1.0 + contrast], [1.0 + saturation], [1.0 + saturation]]) * (sky - middle)
        )

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Residuals at x, whose sum of squares is chi^2."""
        return np.concatenate([self.errors.whitening @ self.difference(x)[self.errors.used], self.before(x)])

    def before(self, x: np.ndarray) -> np.ndarray:
        """Residuals (..., K) of what was known before the picture, of the K parameters that have a usual value."""
        return np.asarray((self.strength * (x - self.usual))[..., self.strength > 0.0])

    def find(self, starts: Sequence[np.ndarray], most: int = 1) -> None:
        """Move to the best x that is found from the best `most` of the starts."""
        if len(starts) > most:
            starts = sorted(starts, key=lambda start: float(np.sum(self.residuals(start) ** 2)))[:most]
        found = min((self.from_start(start) for start in starts), key=lambda one: one[1])
        self.x, self.chi2, self.jacobian = found

    def from_start(self, start: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """(x, chi^2, Jacobian) from a start."""

        def jacobian(x: np.ndarray) -> np.ndarray:
            # differences over a fixed step, inwards: relative ones mean nothing for a value near 0, at a bound
            here, steps = self.residuals(x), np.where(x < 0.5, STEP, -STEP)
            moved = [(self.residuals(x + h * e) - here) / h for h, e in zip(steps, np.eye(x.size), strict=True)]
            return np.stack(moved, -1)

        inside = np.clip(start, 0.01, 0.99)
        found = least_squares(self.residuals, inside, jacobian, bounds=(0.0, 1.0), xtol=1e-3, ftol=1e-4, max_nfev=40)
        x = np.where(found.x < AT_BOUND, 0.0, np.where(found.x > 1.0 - AT_BOUND, 1.0, found.x))
        return x, float(2.0 * found.cost), found.jac

    def camera(self) -> dict[str, np.ndarray]:
        """What the camera most likely did at the best, by kind of mode."""
        found, kinds = self.errors.camera(self.difference(self.x)), np.array(self.errors.kinds)
        found[kinds == "lens"] += LENS_LN[0]
        return {kind: found[kinds == kind] for kind in dict.fromkeys(self.errors.kinds)}

    def strained(self) -> bool:
        """Whether the best contradicts the exposure that a file says by more than `STRAINED` standard errors."""
        told = [frame.log_exposure for frame in self.frames]
        found = self.camera()["exposure"]
        return any(one is not None and abs(at) > STRAINED * one[1] for one, at in zip(told, found, strict=True))

    def curve(self) -> Curve | None:
        """The camera's tone curve at the best, with its saturation; None where neither is free."""
        found, values = self.camera().get("curve"), self.values()
        numbers = () if found is None else tuple(float(g) for g in found)
        if "contrast" not in values:
            return Curve(self.errors.middle, numbers) if numbers else None
        own, of_colours = (1.0 / max(1.0 + values.get(name, 0.0), LEAST_SLOPE) for name in ("contrast", "saturation"))
        return Curve(self.errors.middle, (1.0 - own,), own - of_colours, self.errors.middle_colours)

    def misfit(self) -> float:
        """Sum of squares of `photo.residual_vector` at the best, the tone curve undone, the mean of all frames."""
        curve, found = self.curve(), []
        coloured = bool(self.errors.used[-1])
        free = {"white_balance": self.freedom.white_balance and coloured, "with_colour": coloured}
        for frame, log_xyz in zip(self.frames, self.log_xyz(self.x), strict=True):
            shown = frame if curve is None else replace(frame, xyz=curve.undo(frame.xyz))
            r = residual_vector(shown, np.exp(log_xyz), **free)
            found.append(float(r @ r))
        return float(np.mean(found))
