"""`twilight validate stars`."""

from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table

FIRST_DIGITAL_YEAR = 2000.0
"""Year from which the date of a picture is searched by its planets."""


def stars(
    image: Annotated[Path, argument("IMAGE", "Night exposure: HDR, EXR, TIFF, PNG, JPEG or RAW.")],
    camera: Annotated[Path, option("GUESS.yaml", "Projection and size must be right, the focal length to 10 %.")],
    latitude: Annotated[float | None, options.LATITUDE] = None,
    longitude: Annotated[float | None, options.LONGITUDE] = None,
    at: Annotated[str | None, option("TIME", "Date and time of the middle of the exposure.")] = None,
    time_zone: Annotated[str | None, option("ZONE", "For a time without its offset, e.g. Europe/Berlin.")] = None,
    altitude: Annotated[float, option("KM", "Of the camera; sets the pressure for the refraction.")] = 0.0,
    temperature: Annotated[float, option("DEG_C", "Of the air, for the refraction.")] = 10.0,
    year: Annotated[float, option("YEAR", "Epoch of the stars where the time is not known.")] = 2020.0,
    distortion: Annotated[int, option("N", "Coefficients of distortion to solve, 0 to 4.")] = 2,
    threshold: Annotated[float, option("SIGMA", "Of detection above the local noise.")] = 5.0,
    planets: Annotated[bool, flag("--planets", "Without a time: find the date, from 2000 on, by the planets.")] = False,
    picture: Annotated[Path | None, option("FILE.png", "Draw sources, stars and their names.")] = None,
    output: Annotated[Path | None, option("CAMERA.yaml", "The solved camera; without it, out/camera.yaml.")] = None,
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
    from twilight.studies.validate.stars.coordinates import FIRST_YEAR, LAST_YEAR, pressure_at_hpa
    from twilight.studies.validate.stars.picture import draw

    limits = (
        ("--altitude", altitude, -0.5, 9.0, "km"),
        ("--temperature", temperature, -90.0, 60.0, "deg C"),
        ("--year", year, FIRST_YEAR, LAST_YEAR, ""),
        ("--distortion", distortion, 0, 4, ""),
        ("--threshold", threshold, 2.0, 1000.0, "sigma"),
    )
    for name, value, low, high, unit in limits:
        if not low <= value <= high:
            raise TwilightError(f"{name}: {value:g} must be from {low:g} to {high:g} {unit}".rstrip())
    place, moment = _place_and_time(latitude, longitude, at, time_zone, altitude)
    if planets and moment is not None:
        raise TwilightError("--planets: finds the date of a picture without --at")
    options.check_suffix(output, "--output", ".yaml", ".yml")
    options.check_suffix(picture, "--picture", ".png")
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
            year=year,
            orders=distortion,
            threshold=threshold,
            pressure_hpa=pressure_at_hpa(altitude),
            temperature_c=temperature,
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


def _place_and_time(
    latitude: float | None, longitude: float | None, at: str | None, time_zone: str | None, altitude_km: float
) -> tuple[Any, Any]:
    """(StarSite, moment), or (None, None) where nothing is given."""
    from twilight.studies.validate.stars.coordinates import StarSite

    given = {"--latitude": latitude, "--longitude": longitude, "--at": at}
    missing = [name for name, value in given.items() if value is None]
    if len(missing) == len(given):
        if time_zone is not None:
            raise TwilightError("--time-zone: belongs to --at, which is not given")
        return None, None
    if missing:
        raise TwilightError(f"{', '.join(missing)}: place and time are given together, or not at all")
    where = options.sun_at(at, latitude, longitude, time_zone)
    return StarSite(where.latitude_deg, where.longitude_deg, altitude_km), where.aware(where.at)


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
