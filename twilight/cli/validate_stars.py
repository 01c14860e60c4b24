"""`twilight validate stars`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import EndsIn, Within, argument, flag, option
from twilight.cli.terminal import print_table

FIRST_DIGITAL_YEAR = 2000.0
"""Year from which the date of a picture is searched by its planets."""


@dataclass(frozen=True)
class StarOptions:
    """What a calibration is told of the air, the stars and the camera."""

    altitude: Annotated[
        float, option("KM", "Of the camera; sets the pressure for the refraction."), Within(-0.5, 9.0)
    ] = 0.0
    temperature: Annotated[float, option("DEG_C", "Of the air, for the refraction."), Within(-90.0, 60.0)] = 10.0
    year: Annotated[float, option("YEAR", "Epoch of the stars where the time is not known.")] = 2020.0
    distortion: Annotated[int, option("N", "Coefficients of distortion to solve."), Within(0, 4)] = 2
    threshold: Annotated[float, option("SIGMA", "Of detection above the local noise."), Within(2.0, 1000.0)] = 5.0


def stars(
    image: Annotated[Path, argument("IMAGE", "Night exposure: HDR, EXR, TIFF, PNG, JPEG or RAW.")],
    camera: Annotated[Path, option("GUESS.yaml", "Projection and size must be right, the focal length to 10 %.")],
    middle: options.PlaceAndTime,
    how: StarOptions,
    planets: Annotated[bool, flag("--planets", "Without a time: find the date, from 2000 on, by the planets.")] = False,
    picture: Annotated[
        Path | None, option("FILE.png", "Draw sources, stars and their names."), EndsIn([".png"])
    ] = None,
    output: Annotated[
        Path | None, option("CAMERA.yaml", "The solved camera; without it, out/camera.yaml."), EndsIn([".yaml", ".yml"])
    ] = None,
) -> None:
    """Calibrate a camera from stars: orientation, focal length, principal point and distortion.

    With place and time the orientation is solved against the horizon.  Without them it is solved against the fixed
    stars, and the elevation and roll of the guess say where the zenith is: its right ascension and declination are
    the local sidereal time and the latitude.
    """
    from twilight.base.whole_files import check_file
    from twilight.io.stored_image import read_image
    from twilight.studies.camera import CameraModel, read_camera, write_camera
    from twilight.studies.camera.response import load_response
    from twilight.studies.validate.stars.calibrate import calibrate
    from twilight.studies.validate.stars.coordinates import FIRST_YEAR, LAST_YEAR, StarSite, pressure_at_hpa
    from twilight.studies.validate.stars.picture import draw

    options.check_range(how.year, "--year", FIRST_YEAR, LAST_YEAR)
    sun = middle.sun()
    place = None if sun is None else StarSite(sun.latitude_deg, sun.longitude_deg, how.altitude)
    moment = None if sun is None else sun.aware(sun.at)
    if planets and moment is not None:
        raise TwilightError("--planets: finds the date of a picture without --at")
    target = output or Path("out") / "camera.yaml"
    for path in (target, picture):
        if path is not None:
            check_file(path)
    guess = read_camera(camera)
    light = read_image(image, load_response(guess.response)).samples
    try:
        calibration = calibrate(
            light,
            guess,
            place,
            moment,
            year=how.year,
            orders=how.distortion,
            threshold=how.threshold,
            pressure_hpa=pressure_at_hpa(how.altitude),
            temperature_c=how.temperature,
        )
    except TwilightError as error:
        raise TwilightError(f"{image}: {error}") from None
    for path in (target, picture):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
    dating = _dated(calibration) if planets else None
    solved = calibration.camera
    if dating is not None:
        solved = CameraModel.model_validate(
            {**solved.model_dump(), "calibration": {**calibration.facts(), **_facts(dating)}}
        )
    write_camera(target, solved)
    if picture is not None:
        draw(light, calibration, picture)
    _report(calibration)
    if planets:
        print(_sentence(dating))
    print(f"wrote {target}" + (f", {picture}" if picture is not None else ""))


def _dated(calibration: Any) -> Any:
    """The date by planets, from the first digital cameras to now."""
    from datetime import UTC, datetime

    from twilight.studies.validate.stars.picture import date_by_planets

    return date_by_planets(calibration, FIRST_DIGITAL_YEAR, datetime.now(UTC).year + 1.0)


def _facts(dating: Any) -> dict[str, Any]:
    return {
        "date_by_planets": f"{dating.first:%Y-%m-%d} to {dating.last:%Y-%m-%d}",
        "planets": {name: f"{distance:.2f} deg off" for name, distance in dating.planets.items()},
        "other_dates": dating.others,
    }


def _sentence(dating: Any) -> str:
    if dating is None:
        return "planets: fewer than two bright sources stand where planets stood at one time"
    where = ", ".join(f"{name} ({distance:.2f} deg off)" for name, distance in dating.planets.items())
    others = f"{dating.others} other dates have as many" if dating.others else "no other date has as many"
    return f"planets: {dating.first:%Y-%m-%d} to {dating.last:%Y-%m-%d} by {where}; {others}"


def _report(calibration: Any) -> None:
    """Figures of the calibration on stdout."""
    camera, fit, facts = calibration.camera, calibration.fit, calibration.facts()
    o = camera.orientation
    rows = [
        ["sources found", str(facts["sources"])],
        ["stars matched", f"{facts['matched']} ({facts['matches_expected_by_chance']:g} expected by chance)"],
        ["refused", f"{facts['refused_by_distance']} too far, {facts['refused_by_brightness']} too bright or faint"],
        ["residual", f"{facts['residual_rms_arcmin']:.2f}' rms, {facts['residual_median_arcmin']:.2f}' median"],
        ["azimuth, elevation, roll", f"{o.azimuth_deg:.3f}, {o.elevation_deg:.3f}, {o.roll_deg:.3f} deg"],
        ["their standard error", f"{calibration.pointing_error_arcmin:.2f}'"],
    ]
    if camera.projection != "latlong":
        x, y = camera.principal_point_px
        relative = 100.0 * fit.standard_errors[3] if "focal_length" in fit.free else None
        error = "not solved" if relative is None else f"+- {relative:.2g} %"
        rows.append(["focal length", f"{camera.focal_length_px:.2f} px ({error})"])
        rows.append(["principal point", f"{x:.2f}, {y:.2f} px" + _unless("principal_point", fit.free)])
        k = ", ".join(f"{v:.5f}" for v in camera.lens.distortion) or "none"
        rows.append(["distortion", k + _unless("k1", fit.free)])
    if calibration.orientation is not None:
        sky = calibration.orientation
        rows.append(["local sidereal time", f"{sky.local_sidereal_time_h:.3f} h"])
        rows.append(["latitude", f"{sky.latitude_deg:.2f} deg, if the guess is level"])
    print_table(["", ""], rows)


def _unless(name: str, free: tuple[str, ...]) -> str:
    return "" if name in free else " (not solved)"
