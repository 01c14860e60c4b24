"""How well cameras are solved from stars: python benchmarks/stars.py [PANORAMA.hdr]

Drawn skies (Hipparcos to Hp 5.5, over Vienna) with known truth: a fisheye and a perspective lens, guessed 5 % and 3 %
off in focal length and without distortion; hot pixels, noise of photons and of reading out, and up to a half of
the stars false.  Errors are angles between true and solved directions of pixels all over the picture.  Then a latitude-
longitude photograph of unknown place and time, if one is given: how many stars fit, and what sky it shows.
Writes results/stars.csv, and for a photograph results/stars_photograph.csv and .png.
"""

from __future__ import annotations

import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import results
from PIL import Image

sys.path.insert(0, str(results.ROOT / "tests"))

from star_pictures import render_stars

from twilight.io.stored_image import read_image
from twilight.studies.camera import CameraModel
from twilight.studies.validate.stars.calibrate import calibrate
from twilight.studies.validate.stars.coordinates import StarSite, horizontal
from twilight.studies.validate.stars.picture import date_by_planets, draw

PLACE = StarSite(48.2, 16.4, 0.2)
"""Vienna: latitude and longitude [deg], altitude [km]."""
MOMENT = datetime(2021, 8, 10, 23, 30, tzinfo=UTC)
"""Of the drawn photographs; a moonless summer night."""
FALSE_FRACTIONS = (0.0, 0.2, 0.5)
"""Of the sources: points that are no star."""
HOT_PIXELS = 500
"""Bright single pixels of the sensor."""
LENSES = {
    "fisheye": (
        {"projection": "equisolid", "image": {"width_px": 1500, "height_px": 1200}},
        {"focal_length_px": 520.0, "distortion": [-0.012, 0.003], "principal_point_px": [757.3, 591.4]},
        {"azimuth_deg": 37.0, "elevation_deg": 80.0, "roll_deg": 12.0},
        545.0,
    ),
    "perspective": (
        {"projection": "perspective", "image": {"width_px": 1500, "height_px": 1000}},
        {"focal_length_px": 1000.0, "distortion": [-0.06, 0.02], "principal_point_px": [741.3, 512.4]},
        {"azimuth_deg": 127.0, "elevation_deg": 44.0, "roll_deg": -7.0},
        1030.0,
    ),
}
HEADER = (
    *("lens", "false_share", "arcmin_per_px", "drawn", "sources", "matched", "residual_rms_arcmin"),
    *("direction_error_rms_arcmin", "direction_error_max_arcmin", "focal_length_error_percent", "processor_s"),
)


def main() -> None:
    stars = horizontal(PLACE, MOMENT, 1013.25, 10.0)
    stars = stars.take(stars.magnitude < 5.5)
    rows = []
    for name, (base, lens, orientation, guessed) in LENSES.items():
        truth = CameraModel.model_validate({**base, "lens": lens, "orientation": orientation})
        guess = CameraModel.model_validate({**base, "lens": {"focal_length_px": guessed}})
        xy = truth.project(stars.directions)
        drawn = int(truth.inside(xy).sum())
        for fraction in FALSE_FRACTIONS:
            false_stars = round(fraction / (1.0 - fraction) * drawn)
            picture = render_stars(xy, stars.magnitude, truth, seed=1, hot_pixels=HOT_PIXELS, false_stars=false_stars)
            start = time.process_time()
            made = calibrate(picture, guess, PLACE, MOMENT)
            seconds = time.process_time() - start
            at = truth.pixel_centres()[10::40, 10::40].reshape(-1, 2)
            a, b = truth.directions(at), made.camera.directions(at)
            error = np.degrees(np.linalg.norm(a - b, axis=1)[a[:, 2] > 0.05]) * 60.0
            rows.append(
                (
                    name,
                    f"{fraction:g}",
                    f"{np.degrees(1.0 / truth.focal_length_px) * 60:.1f}",
                    drawn,
                    len(made.sources),
                    len(made.fit.match),
                    f"{np.degrees(made.fit.rms_rad) * 60:.2f}",
                    f"{np.sqrt(np.mean(error**2)):.3f}",
                    f"{error.max():.3f}",
                    f"{100 * (made.camera.focal_length_px / truth.focal_length_px - 1):+.4f}",
                    f"{seconds:.1f}",
                )
            )
            print(*rows[-1], sep="\t", flush=True)
    results.write(results.FOLDER / "stars.csv", HEADER, rows)
    if len(sys.argv) > 1:
        photograph(Path(sys.argv[1]))


def photograph(path: Path) -> None:
    """A latitude-longitude panorama of the night sky, place and time unknown."""
    light = read_image(path).samples
    guess = CameraModel.model_validate(
        {"projection": "latlong", "image": {"width_px": light.shape[1], "height_px": light.shape[0]}}
    )
    start = time.process_time()
    made = calibrate(light, guess, year=2020.7)
    seconds = time.process_time() - start
    dating = date_by_planets(made, 2000.0, 2036.0)
    facts = {"photograph": path.stem, **made.facts(), "processor_s": round(seconds, 1)}
    facts.pop("method")
    facts["solved"] = " ".join(facts["solved"])
    if dating is not None:
        facts["date_by_planets"] = f"{dating.first:%Y-%m-%d} to {dating.last:%Y-%m-%d}"
        facts["planets"] = " ".join(f"{name} {distance:.2f} deg" for name, distance in dating.planets.items())
        facts["other_dates_2000_to_2036"] = dating.others
    for key, value in facts.items():
        print(key, value, sep="\t")
    results.write(results.FOLDER / "stars_photograph.csv", ("figure", "value"), list(facts.items()))
    drawn = results.FOLDER / "stars_photograph.png"
    draw(light, made, drawn)
    with Image.open(drawn) as whole:
        sky = whole.crop((0, 0, whole.width, round(0.53 * whole.height))).quantize(256, Image.Quantize.MAXCOVERAGE)
    sky.save(drawn, optimize=True)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
