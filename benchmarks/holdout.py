"""Does a fitted air predict what its fit did not see?  Halves of panoramas, frames of evenings, another solver's airs.

    python benchmarks/holdout.py panoramas FOLDER...   # holdout_panoramas.csv, holdout_residuals.csv
    python benchmarks/holdout.py evenings              # holdout_evenings.csv
    python benchmarks/holdout.py drawn                 # holdout_drawn.csv

*panoramas*: every picture of the folders (Poly Haven's, CC0, are copied in many public repositories) is fitted whole,
behind the horizon `typical` and, its sun as found, behind a clean one; then by one half of its clear sky, left, right
or above 30 deg; that half's air, exposure, white balance and contrasts predict the other.  What cannot be fitted has a
row that says why.  `holdout_residuals.csv` is ln(picture / computed) by elevation and azimuth from the sun, the mean
and the scatter over the pictures whose sky is fitted.
*evenings*: drawn by zones as in `phone.py`; one frame is fitted and predicts the others, exposure alone being free.
*drawn*: twenty airs by zones, of which the last ten judge, with refraction, behind a clean horizon or clouds of their
own and not behind the screen that the fit assumes, from altitudes as people's are (`air.ALTITUDE_KM`), with ozone and
albedo as in `phone.py`; in turn a phone's JPEG (`phone.py`: noise, lens, curve, 8 bits) and a panorama of eight frames,
each 4 % (rms) brighter or darker than it should be and 5 % darker in its corners, with noise.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import phone
import results
from PIL import Image

import twilight
from twilight.base.errors import TwilightError
from twilight.io.stored_image import write_exr
from twilight.numerics.directions import direction
from twilight.sky.ephemeris import sun_position
from twilight.studies.camera import CameraModel
from twilight.studies.validate.photographs.air import ALTITUDE_KM
from twilight.studies.validate.photographs.comparison import Balance, balance
from twilight.studies.validate.photographs.picture import Photograph, read_photograph
from twilight.studies.validate.photographs.picture_sky import PhotoSky, simulated_sky

TYPES = ["continental_average"]
"""Aerosol types that are tried: one, for the time of twenty pictures."""
UPPER_DEG = 30.0
"""Elevation above which lies half of a hemisphere [deg]."""
HALVES = (("left", "right"), ("right", "left"), ("upper", "lower"))
"""Which half is fitted, and which predicted."""
JUDGED_FROM = 10
"""Number of the first drawn air that judges; those before were seen when factors of intervals were chosen."""
FRAMES = 8
"""Frames of a stitched panorama."""
SEAM = 0.04
"""Relative error (rms) of their brightness."""
CORNER = 0.05
"""Relative darkening of their corners."""
PANORAMAS = (
    *("picture", "fitted", "predicted", "fit_percent", "prediction_percent", "fit_uv", "prediction_uv"),
    *("sun_elevation_deg", "type", "aerosol", "low_68", "high_68", "low_95", "high_95", "ozone", "albedo"),
    *(
        "heading_deg",
        "contrast",
        "saturation",
        "misfit",
        "misfit_clean",
        "aerosol_clean",
        "amplitude",
        "processor_time_s",
        "what_happened",
    ),
)
EVENINGS = ("evening", "sun_fitted_deg", "sun_predicted_deg", "fit_percent", "prediction_percent", "prediction_uv")


def half(name: str, elevation_deg: np.ndarray, beside_deg: np.ndarray) -> np.ndarray:
    """Directions of a half of the sky, as seen by who looks at the sun."""
    beside = (beside_deg + 180.0) % 360.0 - 180.0
    upper = elevation_deg >= UPPER_DEG
    return {"left": beside < 0, "right": beside >= 0, "upper": upper, "lower": ~upper}[name]


def half_of(sky: PhotoSky, name: str) -> np.ndarray:
    """Cells (E, A) of a half of the sky."""
    return half(name, sky.elevation_deg[:, None], sky.azimuth_deg[None, :]) & sky.counts


def masked_to(photograph: Photograph, sun_azimuth_deg: float, name: str) -> Photograph:
    """The photograph with one half of its sky."""
    azimuth, elevation = photograph.camera.azimuth_elevation(photograph.camera.pixel_centres())
    return replace(photograph, mask_image=half(name, elevation, azimuth - sun_azimuth_deg).astype(float))


def errors(sky: PhotoSky, computed: PhotoSky, by: Balance, where: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Root mean square of ln(picture / computed) in per cent, median distance in u'v', and that logarithm (E, A)."""
    xyz = by.apply(sky.xyz)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(where, np.log(xyz[..., 1] / computed.xyz[..., 1]), np.nan)
    there = np.isfinite(ratio)
    weight = sky.solid_angle_sr[there]
    off = np.hypot(*(twilight_uv(xyz[there]) - twilight_uv(computed.xyz[there])).T)
    rms = 100.0 * float(np.sqrt(np.average(ratio[there] ** 2, weights=weight)))
    return rms, float(np.median(off)), ratio


def twilight_uv(xyz: np.ndarray) -> np.ndarray:
    """u', v' (n, 2)."""
    return 3.0 * np.stack([4 / 3 * xyz[:, 0], 3.0 * xyz[:, 1]], -1) / (xyz @ [1.0, 15.0, 3.0])[:, None]


def panorama(path: Path) -> tuple[list[list[Any]], np.ndarray | None]:
    """Rows of a picture, and its residuals (30, 120) by elevation and azimuth from the sun where it is fitted."""
    begin = time.process_time()
    try:
        photograph = read_photograph(path)
        whole = twilight.estimate(photograph, white_balance=True, name=path.name, types=TYPES)
        sky = whole.sky
        seen = whole.photograph.seen(whole.sun_azimuth_deg, sky.apparent_sun_elevation_deg)
    except TwilightError as error:
        why = str(error).replace(str(path), path.name)[:160]
        return [[path.stem, *[""] * (len(PANORAMAS) - 3), f"{time.process_time() - begin:.1f}", why]], None
    seconds = time.process_time() - begin
    computed, straight = simulated_sky(sky, seen), undone(seen, whole)
    fit = errors(straight, computed, balance(straight, computed, True), seen.counts)
    happened = "fitted" if whole.fits else whole.sentences()[0].partition(";")[0]
    here = {"sun_elevation_deg": whole.sun_elevation_deg, "sun_azimuth_deg": whole.sun_azimuth_deg, "types": TYPES}
    clean = twilight.estimate(photograph, white_balance=True, settings={"horizon": "clean"}, **here).best
    beside = [clean.misfit, clean.values["aerosol"]]
    rows = [row_of(path.stem, "whole", "", (fit[0], ""), (fit[1], ""), whole, seconds, happened, beside)]
    for fitted, predicted in HALVES if whole.fits else ():
        begin = time.process_time()
        at = {"sun_elevation_deg": whole.sun_elevation_deg, "sun_azimuth_deg": whole.sun_azimuth_deg}
        part = masked_to(whole.photograph, whole.sun_azimuth_deg, fitted)
        try:
            found = twilight.estimate(part, white_balance=True, types=[whole.best.aerosol_type], name=path.name, **at)
        except TwilightError as error:
            rows.append([path.stem, fitted, predicted, *[""] * (len(PANORAMAS) - 4), str(error)[:160]])
            continue
        mine, other = half_of(seen, fitted), half_of(seen, predicted)
        made, straight = simulated_sky(found.sky, seen), undone(seen, found)
        by = balance(replace(straight, solid_angle_sr=np.where(mine, seen.solid_angle_sr, 0.0)), made, True)
        one, two = errors(straight, made, by, mine), errors(straight, made, by, other)
        seconds = time.process_time() - begin
        rows.append(row_of(path.stem, fitted, predicted, (one[0], two[0]), (one[1], two[1]), found, seconds, ""))
    return rows, fit[2] if whole.fits else None


def undone(seen: PhotoSky, found: Any) -> PhotoSky:
    """A picture with the contrasts of light, by an estimate."""
    return seen if found.best.curve is None else replace(seen, xyz=found.best.curve.undo(seen.xyz))


def row_of(name, fitted, predicted, percent, uv, found, seconds, happened, clean=("", "")) -> list[Any]:
    """A row of `PANORAMAS`."""
    p = found.parameters
    depth = p["aerosol"]
    numbers = [*percent, *uv, found.sun_elevation_deg]
    interval = [depth.value, depth.low, depth.high, depth.low_95, depth.high_95]
    rest = [p[key].value if key in p else "" for key in ("ozone", "albedo", "heading", "contrast", "saturation")]
    last = [*interval, *rest, found.best.misfit, *clean, found.best.amplitude]
    first = [name, fitted, predicted, *(short(x) for x in numbers), found.best.aerosol_type]
    return [*first, *(short(x) for x in last), f"{seconds:.1f}", happened]


def short(x: float | str) -> str:
    """Three digits."""
    return x if isinstance(x, str) else f"{x:.3g}"


def panoramas(folders: list[Path]) -> None:
    """All pictures of the folders; row by row, resumes."""
    table = results.FOLDER / "holdout_panoramas.csv"
    rows, command, maps = results.kept(table), "python benchmarks/holdout.py panoramas FOLDER", []
    whole = not rows  # residuals of what was fitted before are not kept
    for path in (path for folder in folders for path in sorted(folder.glob("*.hdr"))):
        if any(row[0] == path.stem for row in rows):
            continue
        made, residuals = panorama(path)
        rows += made
        results.write(table, PANORAMAS, rows, notes=summary(rows), command=command)
        print(*made, sep="\n", flush=True)
        if residuals is not None and whole:
            maps.append(residuals)
            write_residuals(maps, command)


def write_residuals(maps: list[np.ndarray], command: str) -> None:
    """Mean and scatter over the pictures in cells of 9 x 30 deg."""
    rows = []
    with np.errstate(invalid="ignore"):
        blocks = np.array([np.nanmean(m.reshape(10, 3, 12, 10), axis=(1, 3)) for m in maps])
    for e in range(10):
        for a in range(12):
            values = blocks[:, e, a][np.isfinite(blocks[:, e, a])]
            if values.size:
                row = [9 * e + 4.5, (30 * a + 15 + 180) % 360 - 180, values.size, values.mean(), values.std()]
                rows.append([f"{x:.3g}" for x in row])
    columns = ("elevation_deg", "from_sun_deg", "pictures", "mean_ln", "scatter_ln")
    results.write(results.FOLDER / "holdout_residuals.csv", columns, rows, command=command)


def summary(rows: list[list[str]]) -> list[str]:
    """Errors of prediction beside those of fits, and whether the two sides agree on their haze."""
    whole = [row for row in rows if row[1] in ("", "whole")]
    lines = [f"{len(whole)} pictures, {sum(row[-1] == 'fitted' for row in whole)} fitted"]
    for fitted, predicted in HALVES:
        pairs = [(float(r[3]), float(r[4])) for r in rows if r[1] == fitted and r[4]]
        if pairs:
            fit, other = np.median(pairs, axis=0)
            lines.append(f"{fitted} fitted, {predicted} predicted: median rms {fit:.3g} and {other:.3g} %")
    offs = []
    for name in {row[0] for row in rows}:
        sides = [np.log(np.array(r[9:12], float)) for r in rows if r[0] == name and r[1] in ("left", "right") and r[4]]
        if len(sides) == 2:
            error = np.hypot(*(0.5 * (side[2] - side[1]) for side in sides))
            offs.append(abs(sides[0][0] - sides[1][0]) / error)
    if offs:
        one, two = (float(np.mean(np.array(offs) <= k)) for k in (1.0, 2.0))
        lines.append(f"haze of left and right halves: within 1 / 2 joint standard errors {one:.0%} / {two:.0%}")
    return lines


# Evenings ---------------------------------------------------------------------------------------------------------


def evenings(count: int) -> None:
    """One frame of a drawn evening predicts the others."""
    table = results.FOLDER / "holdout_evenings.csv"
    rows = results.kept(table)
    for number in range(phone.FIRST_EVENING, phone.FIRST_EVENING + count):
        if any(row[0] == str(number) for row in rows):
            continue
        with tempfile.TemporaryDirectory() as folder:
            files, _, kind = phone.evening(number, Path(folder))
            shots = [read_photograph(file) for file in files]
        fitted = len(shots) // 2
        found = twilight.estimate(shots[fitted], types=[kind], settings={"aerosol.type": kind}, name="frame")
        camera, seen_by = found.photograph.camera, []
        for k, shot in enumerate(shots):
            at = sun_position(shot.stated.moment, shot.stated.latitude_deg, shot.stated.longitude_deg, 0.0)
            of_fit = sun_position(*(getattr(shots[fitted].stated, n) for n in PLACE), 0.0)
            azimuth = found.sun_azimuth_deg + at.azimuth_deg - of_fit.azimuth_deg
            here = {"sun_elevation_deg": float(at.elevation_deg), "sun_azimuth_deg": azimuth % 360.0}
            sky, compared = found.compared(replace(shot, camera=camera, **here))
            seen = compared.photo
            bright = np.nan_to_num(seen.xyz[..., 1], nan=9.0) > 0.6
            seen = replace(seen, solid_angle_sr=np.where(bright, 0.0, seen.solid_angle_sr))
            computed = simulated_sky(sky, seen)
            if k == fitted:
                one = found.comparison
                gains, first = one.balance.gains, one.figures["luminance_rms_percent"]
            seen_by.append((at.elevation_deg, seen, computed))
        for k, (sun, seen, computed) in enumerate(seen_by):
            if k == fitted:
                continue
            # the curve and the white balance of the one frame; only the exposure is this frame's own
            undone = Balance(1.0, gains, found.best.curve)
            straight = replace(seen, xyz=undone.apply(seen.xyz))
            rms, uv, _ = errors(straight, computed, balance(straight, computed), straight.counts)
            rows.append([str(number), *(short(x) for x in (found.sun_elevation_deg, sun, first, rms, uv))])
            print(*rows[-1], flush=True)
        medians = [np.median([float(row[c]) for row in rows]) for c in (3, 4, 5)]
        note = "medians: fit {:.3g} %, prediction {:.3g} %, {:.3g} in u'v'".format(*medians)
        results.write(table, EVENINGS, rows, notes=[note], command="python benchmarks/holdout.py evenings")


PLACE = ("moment", "latitude_deg", "longitude_deg")


# Drawn by another solver ------------------------------------------------------------------------------------------


def drawn(count: int) -> None:
    """Pictures of airs by zones."""
    table = results.FOLDER / "holdout_drawn.csv"
    columns = ("picture", "kind", "horizon", "altitude_km", *phone.COLUMNS[1:])
    rows = results.kept(table)
    for index in range(count):
        if not any(row[0] == str(index) for row in rows):
            rows += one_drawn(index)
            judged = [[row[0], *row[4:]] for row in rows if int(row[0]) >= JUDGED_FROM]
            command = "python benchmarks/holdout.py drawn"
            notes = [f"judged: airs from {JUDGED_FROM} on", *phone.summary(judged)] if judged else []
            results.write(table, columns, rows, notes=notes, command=command)
            print(*rows[-3:], sep="\n", flush=True)


def one_drawn(index: int) -> list[list[str]]:
    """Rows of a picture: its truth and its intervals."""
    random = np.random.default_rng(7000 + index)
    when, place, sun = phone.moment(random)
    elevation, altitude_km = float(sun.elevation_deg), float(-ALTITUDE_KM * np.log(random.uniform(0.0, 1.0)))
    truth = {
        "aerosol": float(np.exp(random.uniform(np.log(0.04), np.log(0.5)))),
        **phone.usual(random, when, place[0]),
        "sun": elevation,
    }
    kind = phone.TYPES[index % 4]
    horizon: Any = "clean"
    if index % 3:
        cover, top_km, from_km = random.uniform(0.2, 0.8), random.uniform(3.0, 11.0), random.uniform(50.0, 300.0)
        horizon = {"screen": {"clouds": {"cover": float(cover), "top_km": float(top_km), "from_km": float(from_km)}}}
    settings = {
        "aerosol.type": kind, "aerosol.optical_depth_550nm": truth["aerosol"], "gases.ozone.column_du": truth["ozone"],
        "ground.albedo": truth["albedo"], "horizon": horizon, "observer.altitude_km": altitude_km,
        "sun.elevation_deg": elevation,
    }  # fmt: skip
    sky = twilight.render("continental-average", quality="draft", settings=settings)
    by_phone = index % 2 == 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("drawn.jpg" if by_phone else "drawn.exr")
        if by_phone:
            heading, focal_mm = float(sun.azimuth_deg + random.uniform(-25.0, 25.0)) % 360.0, random.uniform(22.0, 28.0)
            rgb = phone.seen(sky, phone.held(heading, focal_mm, random), float(sun.azimuth_deg), random)
            scale = 0.8 / float(np.percentile(rgb.max(axis=-1), 98))
            said = phone.exif(when, place, heading + random.normal(0.0, 5.0), focal_mm, 1.0 / scale, random)
            said.get_ifd(phone.ExifTags.IFD.GPSInfo)[phone.ExifTags.GPS.GPSAltitude] = 1e3 * altitude_km
            Image.fromarray(phone.developed(rgb * scale, random)).save(path, quality=92, exif=said)
        else:
            write_exr(path, stitched(sky, random))
        begin = time.process_time()
        found = twilight.estimate(path, types=[kind], settings={"aerosol.type": kind})
        seconds = time.process_time() - begin
    head = [str(index), "phone" if by_phone else "panorama", "clean" if horizon == "clean" else "clouds"]
    return phone.rows_of([*head, f"{altitude_km:.2f}", f"{elevation:.2f}"], found, truth, seconds)


def stitched(sky: twilight.Sky, random: np.random.Generator) -> np.ndarray:
    """A panorama (256, 512, 3) of frames side by side, each with a brightness and dark corners of its own."""
    camera = CameraModel.model_validate({"projection": "latlong", "image": {"width_px": 512, "height_px": 256}})
    rgb = phone.seen(sky, camera, float(random.uniform(0.0, 360.0)), random)
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())
    frame = (azimuth / (360.0 / FRAMES)).astype(int) % FRAMES
    middle = direction((frame + 0.5) * (360.0 / FRAMES), np.full(frame.shape, 20.0))
    off = np.arccos(np.clip((direction(azimuth, elevation) * middle).sum(axis=-1), -1.0, 1.0))
    levels = np.exp(SEAM * random.standard_normal(FRAMES))[frame] * (1.0 - CORNER * np.minimum(off / 0.7, 1.5) ** 2)
    tint = np.exp(0.1 * random.standard_normal(3))
    return rgb * levels[..., None] * tint * (1.0 + 0.01 * random.standard_normal(rgb.shape))


def main() -> None:
    """Measure, row by row."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("what", choices=["panoramas", "evenings", "drawn"])
    arguments.add_argument("folders", nargs="*", type=Path)
    arguments.add_argument("--count", type=int)
    given = arguments.parse_args()
    if given.what == "panoramas":
        panoramas(given.folders)
    elif given.what == "evenings":
        evenings(given.count or 3)
    else:
        drawn(given.count or 20)


if __name__ == "__main__":
    main()
