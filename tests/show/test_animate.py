"""`twilight animate`: films of a sky in closed form, read back, and what stops one."""

from itertools import pairwise

import numpy as np
import pytest
from closed_sky import FIVE_NM as NM
from filming import MEDIUM, SKY, closed_scene, film, scene
from PIL import Image, ImageSequence

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.engine import solve
from twilight.engine.sun_tables import SunTables
from twilight.engine.table import first_columns, first_rows
from twilight.numerics import spectrum
from twilight.numerics.projections import view_directions
from twilight.scene import resolve
from twilight.show import film as films
from twilight.show.draw import Painter
from twilight.show.film import Animation
from twilight.show.lights import DiscPainter, sky_elevations
from twilight.show.timeline import Pace, meter, smoothed
from twilight.show.tones import Channels
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.lights import Sun
from twilight.sky.tone import Light, Shot, tone_of


def pictures(path):
    with Image.open(path) as image:
        return [np.asarray(frame.convert("RGB"), float) for frame in ImageSequence.Iterator(image)]


@pytest.fixture(scope="module")
def spectra():
    """Tables of the sky in closed form, as a film of suns from 0 to -10 deg has them."""
    nodes = {"rows_deg": first_rows(-90.0, [0.0], 23), "columns_deg": first_columns(17)}
    return SunTables(solve(closed_scene(), cached=False), 0.0, **nodes).between(-10.0, 0.0)


def test_pictures_are_the_table_and_the_field(spectra):
    """A film would show another sky than the field."""
    channels = Channels(NM)
    table = spectra.seen(channels.of)
    elevation, azimuth = view_directions("fisheye", 48)
    painter = Painter(table, elevation, azimuth)
    keep = np.isfinite(elevation) & (elevation > 4.0)
    assert painter.outside.sum() == np.isnan(elevation).sum() > 100
    for sun, turned, distance in ((0.0, 0.0, 1.0), (-4.4, 70.0, 1.0), (-10.0, 0.0, 1.02)):
        found = painter.light(sun, turned, distance)
        held = table.under(sun).light(elevation[keep], azimuth[keep] - turned) / distance**2
        np.testing.assert_allclose(found[keep], held, rtol=2e-4)
        exact = channels.of(SKY.radiance(sun, elevation[keep], azimuth[keep] - turned)) / distance**2
        off = np.abs(found[keep] / exact - 1.0)
        assert off.max() < 0.02 and np.median(off) < 0.002
        assert (found[painter.outside] == 0.0).all()


def test_pictures_have_the_ground_below_the_horizon(spectra):
    """A picture across the horizon: no light of the sky below it, and a pixel on it has some of both."""
    table = spectra.seen(Channels(NM).of)
    elevation, azimuth = np.meshgrid(np.linspace(-2.0, 2.0, 9)[::-1], np.linspace(-20.0, 20.0, 5), indexing="ij")
    found = Painter(table, elevation, azimuth).light(-3.0)
    one = table.under(-3.0)
    np.testing.assert_allclose(found[:4], one.light(elevation[:4], azimuth[:4]), rtol=2e-4)
    np.testing.assert_allclose(found[5:], one.light(elevation[5:], azimuth[5:]), rtol=2e-4)
    both = 0.5 * (one.light(0.0, azimuth[4]) + one.light(-1e-7, azimuth[4]))
    np.testing.assert_allclose(found[4], both, rtol=1e-3)


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_a_film_at_one_exposure_gets_dark_smoothly(tmp_path, suffix):
    """A film would flicker, or leave its frames behind."""
    path = tmp_path / f"sunset{suffix}"
    assert film(path, exposure=9.5).make().drawn == 5
    found = pictures(path)
    assert len(found) == 5 and found[0].shape == (64, 64, 3)
    level = [p.mean() for p in found]
    assert all(a > b + 1.0 for a, b in pairwise(level)) and level[0] > 150.0 and level[-1] < 40.0
    assert [p.name for p in tmp_path.iterdir()] == [path.name]  # no folder of frames is left


def test_exposures_differ_as_they_must(tmp_path):
    """A metered film would get dark, or a constant one stay bright."""
    level = {}
    for how in ("constant", "metered", "eye"):
        tone = {"output.tone_mapping": "eye"} if how == "eye" else {}
        made = film(tmp_path / f"{how}.webp", scene(**tone), exposure=None if tone else how)
        made.make()
        level[how] = np.array([p.mean() for p in pictures(made.output)])
    # eight stops in five pictures: a camera that meters each, over 1 s, shows them as bright; an eye loses some
    assert np.ptp(level["constant"]) > 120.0
    assert np.ptp(level["metered"]) < 25.0
    # by day only contrast counts; below 5 cd m^-2 it gets dark
    assert (np.diff(level["eye"]) < 1.0).all() and 25.0 < np.ptp(level["eye"]) < np.ptp(level["constant"])


SETTINGS_OF_TONES = {"photographic": {}, "eye": {"adapted_cd_per_m2": 1.0}, "camera": {"iso": 800.0, "noise": False}}


@pytest.mark.parametrize("tone", SETTINGS_OF_TONES)
def test_pictures_are_those_of_the_tone(tmp_path, tone):
    """Every picture of a lossless film is what the tone of a file makes of the same light."""
    given = SETTINGS_OF_TONES[tone]
    settings = {f"output.{tone}.{key}": value for key, value in given.items()}
    settings |= {"output.tone_mapping": tone, "output.colour_observer": "cie1931_2deg"}
    settings |= {"observer.view.kind": "fisheye", "observer.view.height": None, "observer.view.elevation_deg": 90.0}
    made = film(tmp_path / "film.webp", scene(**settings), exposure=None if tone == "eye" else 9.5)
    made.make()
    elevation, azimuth = made._directions(made.view)
    inside = np.isfinite(elevation)
    developer = tone_of(tone, "cie1931_2deg", {tone: given})
    pixel_deg = 180.0 / made.view.width
    for i, picture in enumerate(pictures(made.output)):
        factor = SKY.radiance(made.line.elevation_deg[i], np.nan_to_num(elevation), np.nan_to_num(azimuth))
        seen = developer.see(factor * inside[..., None], NM, Light(spectrum.DEFAULT_SOLAR_SPECTRUM, 1.0))
        expected, _ = developer.develop(seen, Shot(9.5, pixel_deg, i))
        assert np.abs(picture / 255.0 - expected)[inside & (elevation > 4.0)].max() < 0.03, i


def test_noise_of_a_film_moves(tmp_path):
    """A camera's noise is another one in every picture: where it stood still it would look like dirt on the glass."""
    dark = scene(**{"output.tone_mapping": "camera", "output.camera.iso": 6400.0})
    made = film(tmp_path / "film.webp", dark, from_deg=-9.0, to_deg=-9.02, speed=2.0)
    made.make()
    first, second = pictures(made.output)[:2]
    assert (first != second).mean() > 0.5 and abs(first.mean() - second.mean()) < 1.0


def test_a_camera_does_not_lag_and_smooths_flicker():
    """Exposures would lag behind the light, or flicker."""
    line = np.linspace(10.0, -8.0, 200)
    assert np.abs(smoothed(line, 25.0) - line).max() < 1e-9
    flicker = smoothed(line + np.where(np.arange(200) % 2, 1.0, -1.0), 25.0)
    assert np.abs(flicker - line)[80:-80].max() < 0.01
    assert smoothed(np.array([1.0, 5.0]), 0.1) == pytest.approx([1.0, 5.0])
    light = np.full((4, 4, 4), 2.0)
    assert meter(8.0 * light)[0] - meter(light)[0] == pytest.approx(3.0)


def test_an_interrupted_film_draws_what_is_missing(tmp_path, monkeypatch):
    """A film would be made anew, or of two exposures."""
    whole = tmp_path / "whole.webp"
    film(whole, exposure="metered").make()
    draw, solved, path = Animation._draw, [], tmp_path / "cut.webp"

    def cut(self, painter, parts, i, *rest):
        if i == 3:
            raise KeyboardInterrupt
        draw(self, painter, parts, i, *rest)

    monkeypatch.setattr(Animation, "_draw", cut)
    with pytest.raises(KeyboardInterrupt):
        film(path, exposure="metered").make()
    assert not path.exists() and len(list((tmp_path / "cut.webp.frames").glob("*.png"))) == 3
    monkeypatch.setattr(Animation, "_draw", draw)
    monkeypatch.setattr(films, "SunTables", lambda *a, **k: solved.append(1))
    assert film(path, exposure="metered").make().drawn == 2
    assert solved == [] and path.read_bytes() == whole.read_bytes()


def interrupted(monkeypatch, path, **options):
    """Make a film up to its encoding."""
    with monkeypatch.context() as patch:
        patch.setattr(films, "encode", lambda *a: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            film(path, **options).make()


def test_tables_that_are_damaged_are_made_again(tmp_path, monkeypatch):
    """A damaged table would be drawn, or pictures of another exposure put into the film."""
    path = tmp_path / "film.webp"
    interrupted(monkeypatch, path)
    [stored] = (tmp_path / "film.webp.frames").glob("tables-*.npz")
    stored.write_bytes(stored.read_bytes()[:-2000])
    assert film(path).make().drawn == 0 and path.is_file()
    path = tmp_path / "other.webp"
    interrupted(monkeypatch, path, exposure=3.0)
    assert film(path, exposure=4.0).make().drawn == 5


def test_a_film_of_the_night_is_the_night(tmp_path):
    """What is added to the sun's light is `night_radiance` of the place and hour, in the middle of a step too."""
    from datetime import timedelta

    from twilight.io.exr import read_latlong_exr
    from twilight.sky.ephemeris import parse_time, sun_position
    from twilight.sky.night import NightLevels, Place, night_radiance

    evening = {"sun.start": "2026-08-12T20:40+02:00", "sun.stop": "2026-08-12T21:40+02:00"}
    evening |= {"sun.latitude_deg": 47.0, "sun.longitude_deg": 11.0, "observer.view.kind": "fisheye"}
    evening |= {"observer.view.elevation_deg": 90.0}
    times = {"from_deg": None, "to_deg": None, "speed": 1200.0}
    dark, lit = (tmp_path / name for name in ("dark", "lit"))
    film(dark, scene(**evening), **times).make()
    made = film(lit, scene(**evening, **{"night.airglow": 1.0}), **times)
    made.make()
    assert len(made.line) == 4
    elevation, azimuth = made._directions(made.view)
    for i in (0, 3):
        when = parse_time("2026-08-12T20:40+02:00") + timedelta(seconds=1200.0 * i)
        sun = sun_position(when, 47.0, 11.0)
        [with_night, without] = (
            read_latlong_exr(folder / f"{i + 1:05d}.exr").rgb @ [0.2126, 0.7152, 0.0722] * 683.0
            for folder in (lit, dark)
        )
        rows, columns = np.arange(5.0, 91.0, 1.0), np.arange(0.0, 360.0, 3.0)
        night = night_radiance(
            MEDIUM, rows, columns, NightLevels(), sun_elevation_deg=float(sun.elevation_deg),
            sun_azimuth_deg=float(sun.azimuth_deg), place=Place(47.0, 11.0, when),
        )  # fmt: skip
        channels = Channels(NM)
        exact = channels.of(night / channels.solar_irradiance)[..., 1]
        keep = np.isfinite(elevation) & (elevation > 6.0)
        r = np.rint(elevation[keep] - 5.0).astype(int)
        c = np.rint(np.mod(azimuth[keep] - sun.azimuth_deg, 360.0) / 3.0).astype(int) % columns.size
        assert np.median((with_night - without)[keep] / exact[r, c]) == pytest.approx(1.0, abs=0.03)


def test_exr_are_luminances(tmp_path):
    """EXR of a film would be in another unit than those of a render."""
    from twilight.io.exr import read_latlong_exr

    folder = tmp_path / "frames"
    config = scene(**{"observer.view.kind": "fisheye", "observer.view.elevation_deg": 90.0})
    assert film(folder, config).make().drawn == 5
    assert sorted(p.name for p in folder.iterdir()) == [f"{i:05d}.exr" for i in range(1, 6)]
    first, last = (read_latlong_exr(folder / name) for name in ("00001.exr", "00005.exr"))
    exact = Channels(NM).of(SKY.radiance(0.0, 90.0, 0.0))[1]
    luminance = first.rgb[31, 31] @ [0.2126, 0.7152, 0.0722] * first.attributes["whiteLuminance"]
    assert luminance == pytest.approx(exact, rel=0.01)
    assert last.rgb[31, 31, 1] / first.rgb[31, 31, 1] == pytest.approx(10.0**-2.5, rel=0.01)
    with pytest.raises(TwilightError, match="exists; a film in EXR makes a new folder"):
        film(folder, config)
    with pytest.raises(TwilightError, match="EXR hold luminances"):
        film(tmp_path / "others", config, exposure="metered")


def test_mp4_is_read_back(tmp_path):
    """The MP4 would have another size, rate or number of pictures."""
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "sunset.mp4"
    film(path, exposure=9.5, frames_per_second=2.0, speed=1200.0).make()
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    level = [np.frombuffer(frame, np.uint8).mean() for frame in reader]
    assert about["size"] == (64, 64) and about["fps"] == 2.0 and about["codec"] == "h264"
    assert len(level) == 5 and all(a > b for a, b in pairwise(level)) and level[0] > 150.0


def test_the_disc_has_its_light_and_is_flattened():
    """The disc of a film would have other light or shape."""
    nodes = sky_elevations(0.0)
    refraction_deg = 0.5 * np.exp(-nodes / 2.0)  # deg; the disc's image is compressed by about a fifth at 0.4 deg
    beam = np.full((nodes.size, 4), 1000.0)
    step = 0.004
    e, a = np.meshgrid(np.arange(0.0, 2.0, step), np.arange(-1.0, 1.0, step), indexing="ij")
    straight = DiscPainter(0.0 * refraction_deg, beam, 0.0).light(e, a, step, Sun(1.0), 1.0)
    solid = np.radians(step) ** 2 * np.cos(np.radians(e))
    assert (straight[..., 1] * solid).sum() == pytest.approx(1000.0, rel=0.01)
    assert straight[250, 250, 1] / straight[250 + 60, 250, 1] > 1.3  # darker towards the limb
    filled = DiscPainter(refraction_deg, beam, 0.0).light(e, a, step, Sun(0.0), 0.0)[..., 1] > 0.0
    tall, wide = filled.sum(axis=0).max() * step, filled.sum(axis=1).max() * step
    assert wide == pytest.approx(2.0 * SOLAR_RADIUS_DEG, rel=0.02) and 0.75 < tall / wide < 0.92


def test_a_place_gives_the_suns_of_its_evening(tmp_path):
    """A film of a place would have other suns."""
    from twilight.sky.ephemeris import sun_position

    day = {"sun.start": "2026-06-21T21:30+02:00", "sun.stop": "2026-06-21T22:30+02:00"}
    config = scene(**day, **{"sun.latitude_deg": 52.5, "sun.longitude_deg": 13.4})
    made = film(tmp_path / "a.webp", config, from_deg=None, to_deg=None, speed=1800.0)
    exact = sun_position("2026-06-21T22:30+02:00", 52.5, 13.4)
    assert len(made.line) == 3
    assert made.line.elevation_deg[-1] == pytest.approx(exact.elevation_deg, abs=1e-6)
    assert made.line.azimuth_deg[-1] == pytest.approx(exact.azimuth_deg, abs=1e-6)
    with pytest.raises(TwilightError, match="--from, --to: the configuration has a time"):
        film(tmp_path / "a.webp", config)


def test_as_many_pictures_as_asked_for(tmp_path):
    """--frames: the whole way, from the first sun to the last, in that many; a sequence is a path."""
    from twilight.config import load
    from twilight.show.timeline import timeline

    line = timeline(load("pure-air"), Pace(from_deg=4.0, to_deg=-8.0, frames=48))
    assert len(line) == 48 and line.elevation_deg[[0, -1]] == pytest.approx([4.0, -8.0])
    place = {"latitude_deg": 48.0, "longitude_deg": 11.0, "start": "2026-06-21T20:00Z", "stop": "2026-06-21T21:00Z"}
    line = timeline(load("pure-air", {"sun": place}), Pace(frames=10))
    assert len(line) == 10 and line.time_s[-1] == pytest.approx(3600.0)
    config = scene(**{"sun.elevations_deg": [0.0, 5.0, -5.0]})
    line = film(tmp_path / "a.webp", config, from_deg=None, to_deg=None, speed=300.0).line
    assert line.elevation_deg[:5] == pytest.approx([0.0, 1.25, 2.5, 3.75, 5.0])
    assert line.elevation_deg[-1] == pytest.approx(-5.0) and len(line) == 13


@pytest.mark.slow
@pytest.mark.parametrize("air", ["continental-average", "pure-air"])
def test_frames_are_the_field(air, tmp_path):
    """Luminances of frames beside lines of sight that the field is asked for: the figures of docs/animate.md."""
    from twilight.io.exr import read_latlong_exr
    from twilight.sky.colour import REC709_LUMINANCE

    view = {"observer.view.kind": "fisheye", "observer.view.width": 48, "observer.view.elevation_deg": 90.0}
    made = Animation(
        load(air, {**view, "solver.quality": "draft"}), tmp_path / "f", Pace(from_deg=2.0, to_deg=-10.0, frames=3)
    )
    made.make()
    solved = solve(resolve(made.config))
    elevation, azimuth = made._directions(made.view)
    channels = Channels(solved.medium.wavelength_nm)
    for i, sun in enumerate((2.0, -4.0, -10.0)):
        away = np.hypot(elevation - sun, azimuth - 360.0 * (azimuth > 180.0))
        keep = np.isfinite(elevation) & (elevation > 4.0) & (away > 1.0)
        exact = channels.of(solved.radiance(sun, elevation[keep], azimuth[keep]))[:, 1]
        found = read_latlong_exr(tmp_path / "f" / f"{i + 1:05d}.exr").rgb[keep] @ REC709_LUMINANCE * 683.002
        off = 100.0 * np.abs(found / exact - 1.0)
        print(f"{air} sun {sun:+g}: 95 % {np.percentile(off, 95):.2f} %, worst {off.max():.2f} %")
        assert np.percentile(off, 95) < 0.5 and off.max() < 2.0, sun
