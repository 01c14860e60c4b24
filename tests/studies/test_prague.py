"""The file of the Prague Sky Model: its bytes, its angles, its sums of products, and what readers find in it."""

import math
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.config import load_climate
from twilight.engine.table import fill
from twilight.numerics.spectrum import solar_at
from twilight.scene.medium import climate_medium
from twilight.studies.export import prague, prague_air
from twilight.studies.export.prague_air import airs_of, channel_nodes, ground_extinction_per_km
from twilight.studies.export.prague_file import PragueAxes, write_prague
from twilight.studies.export.prague_sky import angles_of, distance_nodes_m, elevation_of
from twilight.transport.scattered_once import ScatteredOnce

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from prague_reader import PragueSky, read_prague

READER = os.environ.get("TWILIGHT_PRAGUE_READER", "")
"""Folder with PragueSkyModel.cpp and PragueSkyModel.h of github.com/PetrVevoda/pragueskymodel."""
AXES = PragueAxes(
    np.array([30.0, 80.0]), np.array([0.0, 1.0]), np.array([50.0]), np.array([-12.0, -11.75, 0.0, 20.0]), 2, 440.0,
    120.0,
)  # fmt: skip
NODES = channel_nodes(2, 440.0, 120.0, 1)


class SmoothField:
    """A sky in closed form over a real medium: falls with the sun and away from it, polarised as by molecules."""

    def __init__(self, medium, brightness):
        self.medium, self.brightness = medium, brightness
        self.scene = SimpleNamespace(medium=medium)
        self.once = ScatteredOnce(medium, None, medium.bottom_km, aerosol=False)

    def of_terms(self, value):
        return value(self.medium)

    def table(self, sun, altitude_km, *, rows_deg, columns_deg, refine, **_):
        def light(rows, columns):
            return self.stokes(sun, *np.meshgrid(rows, columns, indexing="ij"))

        return fill(light, self.once, sun, rows_deg, columns_deg, refine=refine)

    def radiance(self, sun, elevation, azimuth):
        angles = angles_of(sun, elevation, azimuth, 50.0)
        shape = (1.0 + np.cos(angles.gamma) ** 2 + 3.0 * np.exp(-2.0 * angles.gamma)) * (
            1.3 + np.cos(angles.shadow if sun < 0 else angles.zero)
        )
        light = self.brightness * math.exp(1.1 * min(sun, 0.0)) * shape / (0.2 + np.cos(angles.zero))
        return light[..., None] * np.array([0.02, 0.01])

    def stokes(self, sun, elevation, azimuth):
        light = self.radiance(sun, elevation, azimuth)
        degree, chi = rayleigh(sun, elevation, azimuth)
        parts = [np.ones_like(degree), degree * np.cos(2 * chi), degree * np.sin(2 * chi)]
        return light[..., None, :] * np.stack(parts, axis=-1)[..., None]


def rayleigh(sun, elevation, azimuth):
    """Degree, and angle from the vertical to the right [rad], of light that molecules scattered once, by vectors."""
    e, a, s = np.radians(elevation), np.radians(azimuth), math.radians(sun)
    view = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)  # sun at x, right is +y there
    right = np.stack([-np.sin(a), np.cos(a), 0 * a], axis=-1)
    up = np.stack([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)], axis=-1)
    across = np.cross(view, np.array([math.cos(s), 0.0, math.sin(s)]))
    mu = view @ np.array([math.cos(s), 0.0, math.sin(s)])
    return (1 - mu**2) / (1 + mu**2), np.arctan2((across * right).sum(-1), (across * up).sum(-1))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A file of two visibilities and two albedos, brighter by 2 with the second one of each, and its sky."""
    medium = climate_medium(load_climate("bruneton2008"), None).select(np.array([2, 1]))

    def field_of(v, b, progress):
        return SmoothField(medium, 2.0 ** (v + b))

    path = tmp_path_factory.mktemp("prague") / "sky.dat"
    size = write_prague(path, prague.PragueMaker(AXES, NODES, 6, True).make(field_of, silent))
    assert size == path.stat().st_size
    return path, PragueSky.load(path), medium


def directions(count=200):
    random = np.random.default_rng(3)
    return np.degrees(np.arcsin(random.uniform(0.01, 1.0, count))), random.uniform(0.0, 180.0, count)


@pytest.mark.parametrize(
    "view, sun, altitude, gamma, shadow, zero",
    [
        ((0.7854, 3.1416), 0.5236, 50.0, 1.8325963268, 0.2590079347, 0.7826079346),
        ((0.0, 0.0), 0.5236, 50.0, 1.0471963268, 0.5236, 0.0),
        ((1.5708, 0.0), 0.5236, 50.0, 0.5236036732, 2.0904403854, 1.5668403854),
        ((0.7854, 0.0), -0.05, 50.0, 0.8353963268, 0.7326079346, 0.7826079346),
        ((0.7854, 3.1416), 0.5236, 150.0, 1.8325963268, 0.2569739464, 0.7805739464),
    ],
)
def test_angles_are_those_of_the_published_reader(view, sun, altitude, gamma, shadow, zero):
    # colour-science's tests of its reader, which are those of the reader in C++ (colour/phenomena/sky/tests)
    """Other readers would find other skies (colour-science's figures)."""
    theta, azimuth = view
    found = angles_of(math.degrees(sun), 90.0 - math.degrees(theta), math.degrees(azimuth), altitude)
    np.testing.assert_allclose(np.array(found), [gamma, zero, shadow], atol=2e-7)
    assert elevation_of(math.degrees(zero), altitude) == pytest.approx(90.0 - math.degrees(theta), abs=1e-4)


def test_least_squares_find_a_sum_of_products():
    """The fit would not find a sky that it can hold."""
    random = np.random.default_rng(0)
    count, rank = 3000, 3
    sides = []
    for breaks in (20, 15):
        place = random.uniform(0, breaks - 1, count)
        sides.append(prague.linear_basis(place.astype(int), place % 1.0, breaks))
    truth = [random.uniform(0.5, 1.5, (2, side.breaks, rank)) for side in sides]
    parts = [prague.at_directions(side, values) for side, values in zip(sides, truth, strict=True)]
    target = (parts[0] * parts[1]).sum(-1)
    found = prague.alternate(*sides, target, target**-2, prague.first_guess(20, 15, 2, 4), 40)
    again = [prague.at_directions(side, values) for side, values in zip(sides, found, strict=True)]
    assert np.percentile(np.abs((again[0] * again[1]).sum(-1) / target - 1), 99) < 5e-3


def test_a_channel_s_nodes_are_exact_for_a_cubic_of_the_wavelength():
    """Channels would be off their means."""
    nodes = channel_nodes(2, 320.0, 40.0, 2)
    for c in range(2):
        fine = 320.0 + 40.0 * c + (np.arange(4000) + 0.5) / 100.0
        exact = (solar_at(fine) * (fine / 400.0 - 1.2) ** 3).mean()
        assert nodes.mean((nodes.wavelength_nm / 400.0 - 1.2) ** 3)[c] == pytest.approx(exact, rel=1e-3)
        assert nodes.mean(np.ones(4))[c] == pytest.approx(solar_at(fine).mean(), rel=1e-3)


def test_a_visibility_is_koschmieder_s():
    """A visibility would be of another haze."""
    for air in airs_of(["continental-average"], (25.0, 100.0)):
        assert ground_extinction_per_km(air.config(0.3, "draft")) == pytest.approx(3.912 / air.visibility_km, rel=1e-4)
        assert air.config(0.3, "draft").climate.ground.albedo == 0.3
    own = airs_of(["continental-clean", "continental-average"], None)
    assert own[0].visibility_km < own[1].visibility_km and own[1].series.config({}).title == "continental-clean"
    with pytest.raises(TwilightError, match="is seen through for"):
        airs_of(["continental-average"], (399.0,))
    with pytest.raises(TwilightError, match="is for one climate"):
        airs_of(["continental-average", "urban"], (20.0,))


@pytest.mark.parametrize("sun", [-12.0, -11.75, 0.0, 20.0])
def test_skies_are_those_that_went_in(made, sun):
    """Readers would find other skies than were exported."""
    _, sky, medium = made
    e, a = directions()
    for v, b in ((0, 0), (1, 1)):
        exact = NODES.mean(SmoothField(medium, 2.0 ** (v + b)).radiance(sun, e, a))
        for c in range(2):
            found = sky.radiance(sun, e, a, 470.0 + 120 * c, visibility_km=AXES.visibility_km[v], albedo=AXES.albedo[b])
            assert np.percentile(np.abs(found / exact[:, c] - 1), 95) < 0.01
    polarised = sky.polarisation(sun, e, a, 500.0, visibility_km=30.0, albedo=0.0)
    assert np.percentile(np.abs(polarised - rayleigh(sun, e, a)[0]), 95) < 0.01


def test_between_nodes_skies_are_mixed(made):
    """Between nodes readers would jump."""
    _, sky, _ = made
    one = sky.radiance(20.0, 40.0, 30.0, 500.0, visibility_km=30.0, albedo=0.0)
    assert sky.radiance(20.0, 40.0, 30.0, 500.0, visibility_km=55.0, albedo=0.5) == pytest.approx(2.25 * one, rel=5e-3)
    low, high = (sky.radiance(s, 90.0, 0.0, 500.0, visibility_km=30.0, albedo=0.0) for s in (-12.0, -11.75))
    mixed = sky.radiance(-11.875, 90.0, 0.0, 500.0, visibility_km=30.0, albedo=0.0)
    assert mixed == pytest.approx(0.5 * (low + high), rel=2e-3)
    assert sky.radiance(20.0, 40.0, 30.0, 439.0, visibility_km=30.0, albedo=0.0) == 0.0


@pytest.mark.parametrize("elevation", [90.0, 30.0, 5.0, 1.0])
def test_transmittance_is_that_of_the_air(made, elevation):
    """The file's sun would be too bright."""
    _, sky, medium = made
    found = sky.transmittance(elevation, 500.0, visibility_km=30.0)
    z = np.linspace(0.0, medium.top_km, 60001)
    r = medium.earth_radius_km + z
    slant = r / np.sqrt(r**2 - (medium.earth_radius_km * math.cos(math.radians(elevation))) ** 2)
    exact = math.exp(-np.trapezoid(medium.at(z).extinction[:, 0] * slant, z))
    assert math.sqrt(found) == pytest.approx(math.sqrt(exact), abs=2e-3)


def test_transmittance_of_a_path_in_the_lowest_air(made):
    """Near objects would fade too soon."""
    _, sky, medium = made
    beta = medium.extinction_per_km[0, 0]
    assert sky.transmittance(0.0, 500.0, 5000.0, visibility_km=30.0) == pytest.approx(math.exp(-5 * beta), rel=5e-3)
    assert distance_nodes_m(prague_air.DISTANCES)[-1] < 1_571_525.0


def test_the_file_begins_as_the_format_says(made, tmp_path):
    """Other readers would refuse the file, or half a file be read."""
    path, sky, _ = made
    content = path.read_bytes()
    assert struct.unpack_from("<iddidd", content) == (2, 30.0, 80.0, 2, 0.0, 1.0)
    assert struct.unpack_from("<id", content, 40) == (1, 50.0)
    assert struct.unpack_from("<i4diddi", content, 52) == (4, -12.0, -11.75, 0.0, 20.0, 2, 440.0, 120.0, 6)
    again = path.with_name("again.dat")
    assert write_prague(again, sky.file) == len(content) and again.read_bytes() == content
    content = made[0].read_bytes()
    for name, wrong in (("short", content[:5000]), ("tail", content + b"1"), ("text", b"what is this"), ("empty", b"")):
        (tmp_path / name).write_bytes(wrong)
        with pytest.raises(TwilightError, match=r"no whole file|behind its end"):
            read_prague(tmp_path / name)


MAIN = """
#include "PragueSkyModel.h"
#include <cstdio>
#include <limits>
int main(int, char** args) {
    PragueSkyModel model;
    model.initialize(args[1]);
    double s, e, a, h, nm, v, b;
    while (std::scanf("%lf %lf %lf %lf %lf %lf %lf", &s, &e, &a, &h, &nm, &v, &b) == 7) {
        auto p = model.computeParameters({0, 0, h}, {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)},
                                         s, 0, v, b);
        std::printf("%.17g %.17g %.17g\\n", model.skyRadiance(p, nm), model.polarisation(p, nm),
                    model.transmittance(p, nm, std::numeric_limits<double>::max()));
    }
}
"""


@pytest.mark.slow
def test_the_published_reader_finds_the_same(made, tmp_path):
    """The published reader would find other skies."""
    if not (Path(READER) / "PragueSkyModel.cpp").is_file() or shutil.which("g++") is None:
        pytest.skip("TWILIGHT_PRAGUE_READER names no folder with PragueSkyModel.cpp, or there is no g++")
    (tmp_path / "main.cpp").write_text(MAIN)
    source = [str(tmp_path / "main.cpp"), str(Path(READER) / "PragueSkyModel.cpp")]
    compiler = "g++ -std=c++17 -O1 -w -include array -include tuple".split()
    subprocess.run([*compiler, f"-I{READER}", *source, "-o", str(tmp_path / "read")], check=True)
    path, sky, _ = made
    e, a = directions(40)
    cases = [(s, *place, 520.0, v, b) for s in (-12.0, -11.9, -0.1, 7.0, 20.0) for place in zip(e, a, strict=True)
             for v, b in ((30.0, 0.0), (44.0, 0.7))]  # fmt: skip
    lines = [f"{math.radians(s):.17g} {math.radians(e):.17g} {math.radians(a):.17g} 0 {nm} {v} {b}"
             for s, e, a, nm, v, b in cases]  # fmt: skip
    read = subprocess.run([str(tmp_path / "read"), str(path)], input="\n".join(lines), capture_output=True, text=True)
    theirs = np.array([line.split() for line in read.stdout.splitlines()], float)
    ours = []
    for s, e_, a_, nm, v, b in cases:
        air = {"visibility_km": v, "albedo": b}
        ours.append([float(sky.radiance(s, e_, a_, nm, **air)), float(sky.polarisation(s, e_, a_, nm, **air)),
                     sky.transmittance(e_, nm, visibility_km=v)])  # fmt: skip
    np.testing.assert_allclose(theirs, ours, rtol=2e-6, atol=1e-9)
