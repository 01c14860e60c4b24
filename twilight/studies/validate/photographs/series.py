"""The air of photographs: where their sun stands, how the camera was held, their cells, and the fit of all together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import part_of
from twilight.base.threads import one_blas_thread
from twilight.config.measured import place_and_time_of
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunElevation, SunElevations
from twilight.io.air.lines import PlaceAndTime
from twilight.numerics.directions import azimuth_elevation, camera_axes
from twilight.scene.usual import usual_horizon, with_usual_ozone
from twilight.sky.ephemeris import SunPosition, sun_position
from twilight.studies.camera.exif import Stated
from twilight.studies.validate.photographs.air import (
    ALBEDO_ERROR,
    OTHERS,
    OZONE_ANYWHERE_DU,
    OZONE_DU,
    SUN,
    SUN_DEG,
    Airs,
    Design,
    Parameter,
    with_settings,
)
from twilight.studies.validate.photographs.estimate import Options, find_air, first_look
from twilight.studies.validate.photographs.fit import ANGLES, CONTRAST, SATURATION, Freedom
from twilight.studies.validate.photographs.options import EstimateOptions
from twilight.studies.validate.photographs.picture import Photograph, check_sky, check_upright, place_sun
from twilight.studies.validate.photographs.picture_sky import Frame
from twilight.studies.validate.photographs.report import Estimate

MOST_CELLS = 160
"""Directions that a fit takes, of one photograph or of all."""

LEAST_CELLS = 40
"""Of each of several photographs."""

RETURNED_DEG = 1.0
"""Turn of a camera beyond which a photograph is cut into cells again [deg]."""

DISC_PITCH_DEG = 0.5
"""Standard error of a camera's elevation by the disc of a sun that is known [deg]."""

LIT_ABOVE_DEG = -0.5
"""A sun that is found above this has glare, which is masked before the fit is made again [deg]."""

LEAST_HEADING_DEG = 0.3
"""Least standard error of a sun's azimuth that was found in the picture [deg]."""


def at_the_camera(photographs: Sequence[Photograph], given: Config) -> tuple[Config, bool, list[str]]:
    """The scene seen from where the camera stood; whether its altitude is known; sentences on that.

    By the scene where that gives one, else by Exif, else on the ground where the scene says how high that is.
    """
    ground_km = given.climate.ground.altitude_km
    said = [one.stated.altitude_m for one in photographs if one.stated.altitude_m is not None]
    if "altitude_km" in given.observer.model_fields_set:
        altitude_km, by = given.observer.altitude_km, "as given"
    elif said:
        altitude_km, by = max(1e-3 * float(np.median(said)), ground_km), f"by Exif ({np.median(said):.0f} m)"
    elif "altitude_km" in given.climate.ground.model_fields_set:
        altitude_km, by = ground_km, "on the ground"
    else:
        note = (
            f"camera: {photographs[0].name} does not say its altitude; taken for the sea's level, and the haze's "
            "interval holds what may lie below it (--set observer.altitude_km)"
        )
        return given, False, [note]
    note = f"camera: {1e3 * altitude_km:.0f} m above the sea, {by}"
    return with_settings(given, {"observer.altitude_km": altitude_km}), True, [note]


def with_file(photograph: Photograph, given: Config) -> tuple[Config, list[str]]:
    """The scene with the file's time and place and the camera's altitude, where the scene says none; sentences."""
    given, remarks = with_time(photograph, given)
    if photograph.stated.altitude_m is not None:
        given, _, above = at_the_camera([photograph], given)
        remarks += above
    return given, remarks


def with_time(photograph: Photograph, given: Config) -> tuple[Config, list[str]]:
    """The scene with the file's time and place, where the scene has no sun; sentences."""
    if "sun" in given.model_fields_set or photograph.stated.sun is None:
        return given, []
    given = with_settings(given, {"sun": photograph.stated.sun})
    return given, [f"the sun's height: {sun_range(given)[0]:.2f} deg by Exif time and place"]


def sun_range(config: Config) -> tuple[float, float, SunPosition | None]:
    """Lowest and highest sun [deg] of the search, equal where it is known, and its position at a place and time."""
    sun = config.sun
    if isinstance(sun, SunAt):
        at = sun_position(sun.aware(sun.at), sun.latitude_deg, sun.longitude_deg, config.observer.altitude_km)
        return (*_known(float(at.elevation_deg)), at)
    if "sun" not in config.model_fields_set:
        return (*SUN_DEG, None)
    if isinstance(sun, SunElevation):
        return (*_known(sun.elevation_deg), None)
    if not isinstance(sun, SunElevations):
        raise TwilightError(
            "sun: a photograph has one time; give sun.at, an elevation, or elevations to search between"
        )
    low, high = (float(np.clip(f(sun.elevations_deg), *SUN_DEG)) for f in (min, max))
    return low, high, None


def _known(elevation_deg: float) -> tuple[float, float]:
    low, high = SUN_DEG
    if not low <= elevation_deg <= high:
        raise TwilightError(
            f"sun: at {elevation_deg:.2f} deg; photographs are fitted with suns from {low:g} to {high:g}"
        )
    return elevation_deg, elevation_deg


@one_blas_thread()
def estimate_air(photographs: Sequence[Photograph], given: Config, says: EstimateOptions) -> Estimate:
    """Fit photographs of one camera, held the same, and one air, behind the horizon that the scene has.

    Errors: TwilightError for whatever cannot be done.
    """
    horizon_known = given.horizon is not None
    given = given.model_copy(update={"horizon": usual_horizon(given, solvers.load("compact"))})
    given, others = _before(given, photographs[0].stated, says.parameters)
    given, altitude_known, above = at_the_camera(photographs, given)
    shown = [placed(*one, given, says) for one in zip(photographs, _suns(photographs, says), strict=True)]
    low, high = shown[0].between_deg
    if len(shown) > 1:
        if any(np.ptp(one.between_deg) > 0.0 for one in shown):
            raise TwilightError(
                "series: the sun of every picture must be known: by Exif time and place, by sun elevations that are "
                "given, or by its disc"
            )
        shown = of_one_camera(shown)
    remarks = list(dict.fromkeys([*(note for one in shown for note in (*one.remarks, *one.sun_remarks)), *above]))
    design = Design(others)
    own = None if given.climate.aerosol is None else given.climate.aerosol.type
    order = sorted(dict.fromkeys(says.types), key=lambda name: name != own)
    airs = Airs(given, design, part_of(says.progress, 0.05, 0.75))
    developed = any(one.developed for one in shown)
    unknown = not all(one.balanced for one in shown)
    rendered = unknown and not developed and says.white_balance is not False
    heading = max(one.heading_error_deg for one in shown)
    free = Freedom(
        white_balance=developed or unknown if says.white_balance is None else says.white_balance,
        curve=developed if says.tone_curve is None else says.tone_curve,
        with_colour=says.colour,
        heading=np.hypot(heading, LEAST_HEADING_DEG) if heading > 0.0 else 0.0,
        pitch=shown[0].errors_deg[1],
        roll=shown[0].errors_deg[2],
        zoom=shown[0].zoom_error,
        contrast=CONTRAST if rendered else 0.0,
        saturation=SATURATION if rendered and says.colour else 0.0,
    )
    most = max(MOST_CELLS // len(shown), LEAST_CELLS)
    options, known = Options(order, own, low, high, free, altitude_known, horizon_known), low == high
    frames = [_frame(one, most, known) for one in shown]
    first = None
    if not known or max(free.pitch, free.roll) > 0.0:
        # a sun and a camera that were not known: cut the pictures into cells again
        first = first_look(airs, frames, options)
        look = first.values()
        lit = not known and look.get(SUN, 0.0) >= LIT_ABOVE_DEG
        if lit or np.hypot(look.get("pitch", 0.0), look.get("roll", 0.0)) > RETURNED_DEG:
            turned = {name: value for name, value in look.items() if name != "zoom"}
            cut = [_found(one, turned) for one in shown]
            frames, first = [_frame(one, most, known, told) for one, told in zip(cut, frames, strict=True)], None
    made = find_air(airs, frames, options, says.progress, None if known else first)
    best = next(one for one in made if one.parameters)
    shown = [_found(one, best.values) for one in shown]
    return Estimate(tuple(shown), given, made, best, free, tuple(remarks))


def _before(given: Config, stated: Stated, names: Sequence[str]) -> tuple[Config, tuple[Parameter, ...]]:
    """The scene with the ozone of its place and day, else of the file's; what is estimated, with what is usual."""
    at = place_and_time_of(given)
    if (at.time is None or at.latitude_deg is None) and stated.sun is not None:
        at = PlaceAndTime(stated.moment, stated.latitude_deg)
    climate, of_ozone = with_usual_ozone(given.climate, at)
    nowhere = at.time is None or at.latitude_deg is None
    error = OZONE_ANYWHERE_DU if nowhere and of_ozone else OZONE_DU
    column, albedo = climate.gases.ozone.column_du, climate.ground.albedo
    usual: dict[str, Any] = {
        "ozone": (column, error, of_ozone or "as the scene has it"),
        "albedo": (albedo if isinstance(albedo, int | float) else None, ALBEDO_ERROR, "as the scene has it"),
    }
    others = []
    for p in (p for p in OTHERS if p.name in names):
        value, error, source = usual[p.name]
        others.append(p if value is None else replace(p, usual=(float(value), error), source=source))
    return given.model_copy(update={"climate": climate}), tuple(others)


def _suns(photographs: Sequence[Photograph], says: EstimateOptions) -> list[float | None]:
    if says.suns_deg is None:
        return [None] * len(photographs)
    if len(says.suns_deg) != len(photographs):
        raise TwilightError(f"sun elevations: gives {len(says.suns_deg)} for {len(photographs)} pictures")
    return [_known(sun)[0] for sun in says.suns_deg]


def placed(photograph: Photograph, told_deg: float | None, given: Config, says: EstimateOptions) -> Photograph:
    """A photograph with what it says of its sun and its camera."""
    check_upright(photograph)
    low, high, at = sun_range(given)
    remarks: list[str] = []
    if told_deg is not None:
        low = high = told_deg
    else:
        scene, said = with_time(photograph, given)
        low, high, at = sun_range(scene)
        remarks += said
    known_azimuth = None if at is None else float(at.azimuth_deg)
    azimuth, error, note, light = place_sun(photograph, known_azimuth, says.sun_azimuth_deg, (low, high))
    remarks.append(note)
    if light is not None:
        middle, tilt, by = light.true_elevation_deg or 0.0, photograph.errors_deg[1], f"its {light.method}"
        if low == high and tilt > DISC_PITCH_DEG:
            # the mean of both, by their errors
            error_deg = max(light.elevation_error_deg, DISC_PITCH_DEG)
            both = np.hypot(tilt, error_deg)
            turn, held = (tilt / both) ** 2 * (low - middle), tilt * error_deg / both
            photograph = photograph.turned(turn, 0.0, (photograph.errors_deg[0], held, photograph.errors_deg[2]))
            remarks.append(f"camera: turned by {turn:+.1f} +- {held:.1f} deg towards where {by} has the sun")
        elif low < high:
            found, off = round(middle, 2), 0.0 if light.method == "disc" else light.elevation_error_deg
            nearest, reach = min(max(found, low), high), 3.0 * float(np.hypot(tilt, off))
            apart = "" if nearest == found else f", of those searched the nearest to it ({found:.2f})"
            remarks.append(f"the sun's height: {nearest:g}{f' +- {off:.1f}' if off else ''} deg by {by}{apart}")
            low, high = max(low, nearest - reach), min(high, nearest + reach)
    remarks += check_sky(photograph, photograph.seen(azimuth, low if low == high else None))
    by_time = None if photograph.camera.orientation.azimuth_deg is None else known_azimuth
    return photograph.told(
        sun_elevation_deg=low if low == high else np.nan,
        sun_azimuth_deg=azimuth,
        between_deg=(low, high),
        heading_error_deg=error,
        sun_remarks=tuple(remarks),
        by_time_deg=by_time,
    )


def of_one_camera(shown: list[Photograph]) -> list[Photograph]:
    """The pictures of a series, whose camera was not moved: it is held in all as those say that know best."""
    errors = np.array([one.errors_deg for one in shown])
    held = [one.camera.orientation for one in shown]
    angles = np.array([[one.elevation_deg, one.roll_deg] for one in held])
    least = errors.min(axis=0)
    elevation, roll = (
        float(np.median(angles[errors[:, k + 1] == least[k + 1], k])) if least[k + 1] > 0.0 else None for k in (0, 1)
    )
    off, error = _by_best_compass(shown)
    made = []
    for one, (pitch, tilt) in zip(shown, angles, strict=True):
        turn = 0.0 if elevation is None else elevation - pitch
        turned = one.turned(turn, 0.0 if roll is None else roll - tilt, tuple(least))
        azimuth = one.sun_azimuth_deg if off is None else (one.by_time_deg or 0.0) + off
        error_deg = one.heading_error_deg if off is None else error
        made.append(turned.told(sun_azimuth_deg=float(azimuth % 360.0), heading_error_deg=error_deg))
    if elevation is not None:
        note = f"camera: held alike in all pictures, {elevation:.1f} deg above the horizontal"
        made[0] = made[0].told(sun_remarks=(*made[0].sun_remarks, note))
    return made


def _by_best_compass(shown: list[Photograph]) -> tuple[float | None, float]:
    """How far the compass is off by the pictures that know best, and its error then [deg]; None where north or the time
    of a picture is not known."""
    least = min(one.heading_error_deg for one in shown)
    off = [
        (one.sun_azimuth_deg - one.by_time_deg + 180.0) % 360.0 - 180.0
        for one in shown
        if one.by_time_deg is not None and one.heading_error_deg <= 2.0 * least
    ]
    known = all(one.by_time_deg is not None for one in shown)
    return (float(np.median(off)), least) if off and known else (None, least)


def _frame(photograph: Photograph, most: int, known: bool, told: Frame | None = None) -> Frame:
    """A photograph cut into the cells of a fit; told: the same with the camera that its angles count from."""
    sun, held = photograph.sun_elevation_deg, photograph.camera.orientation
    camera = ((held.azimuth_deg or 0.0) - photograph.sun_azimuth_deg, held.elevation_deg, held.roll_deg)
    frame = Frame.of(
        photograph.seen(photograph.sun_azimuth_deg, sun if np.isfinite(sun) else None),
        most,
        camera_deg=camera,
        sun_deg=sun if known else None,
        log_exposure=photograph.log_exposure,
        eight_bits=photograph.developed and photograph.picture.bits == 8,
    )
    if told is not None:
        azimuth, elevation = azimuth_elevation(frame.own @ camera_axes(*told.camera_deg))
        frame = replace(frame, elevation_deg=elevation, azimuth_deg=azimuth, camera_deg=told.camera_deg)
    frame = frame.below_white() if frame.eight_bits else frame
    if photograph.camera.projection == "latlong":
        return frame
    corner = float(photograph.camera.angle_off_axis(np.array([0.0, 0.0])))
    corner = corner if np.isfinite(corner) else np.radians(90.0)
    off = np.arccos(np.clip(frame.own[:, 1], -1.0, 1.0))
    return replace(frame, lens=(off / corner) ** 2)


def _found(photograph: Photograph, values: Mapping[str, float]) -> Photograph:
    """A photograph with its camera and sun as they were found."""
    heading, pitch, roll, zoom = (values.get(name, 0.0) for name in ANGLES)
    if pitch or roll or zoom:
        photograph = photograph.turned(pitch, roll, photograph.errors_deg, zoom)
    sun = values.get(SUN, photograph.sun_elevation_deg)
    azimuth = float((photograph.sun_azimuth_deg - heading) % 360.0)
    return photograph.told(sun_elevation_deg=float(sun), sun_azimuth_deg=azimuth)
