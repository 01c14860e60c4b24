"""An evening as a table: columns, the times at which they pass a value, presets, files."""

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.numerics import spectrum
from twilight.sky.ephemeris import sun_position
from twilight.sky.quantities.measure import Spectra
from twilight.studies import timeline as work
from twilight.studies.timeline import PRESETS, column
from twilight.studies.timeline_files import draw, shades, write_dataset, write_table

PLACE = (28.3, -16.5)
NM = np.arange(380.0, 721.0, 20.0)


class Slope:
    """A grey light that falls by e for every degree of the sun: a field with a closed form."""

    wavelength_nm = NM
    solved = SimpleNamespace(solar_spectrum=spectrum.DEFAULT_SOLAR_SPECTRUM, scene=SimpleNamespace(altitude_km=0.0))

    def prepare(self, moments, progress=None):
        pass

    def spectra(self, light):
        return Spectra(light, NM, where="the field")

    def directions(self, moments, elevation, azimuth, sources=None):
        return np.exp(moments.sun.elevation_deg)[:, None, None] * np.ones((1, 1, NM.size))

    def surfaces(self, moments, surfaces, sources=None):
        return self.directions(moments, None, None)


def evening(step_s: float = 300.0) -> list[datetime]:
    start = datetime(2026, 3, 20, 18, 0, tzinfo=UTC)
    return work.rows(start, start + timedelta(hours=4), timedelta(seconds=step_s))


def test_a_crossing_is_found_to_the_second():
    """A time would be off by a minute."""
    level = float(column("luminance@zenith").values(Slope(), work.moments_at([28.3], [-16.5], evening()[:1]))[0])
    at_start = float(sun_position(evening()[0], *PLACE).elevation_deg)
    threshold = float(level * np.exp(-7.25 - at_start))
    made = work.timeline(Slope(), *PLACE, evening(), [column("luminance")],
                         [work.condition(f"luminance < {threshold!r}"), work.condition("luminance < 1e-30"),
                          work.condition("luminance > 1e-30")])  # fmt: skip
    crossing = made.outcomes[0].crossings[0]
    assert crossing.begins and len(made.outcomes[0].crossings) == 1
    # the sun sinks by 0.2 deg a minute: 0.004 deg a second
    assert float(sun_position(crossing.time, *PLACE).elevation_deg) == pytest.approx(-7.25, abs=0.004)
    assert [outcome.sentence for outcome in made.outcomes[1:]] == ["not reached", "all the time"]
    events = [mark.event for mark in made.marks]
    assert events == ["sunset", "civil dusk", "nautical dusk", "astronomical dusk", "moonset"]


def test_a_day_without_dusk_says_so_once():
    """A polar day would have a dusk."""
    start = datetime(2026, 6, 20, 0, 0, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=30), timedelta(hours=1))
    made = work.timeline(Slope(), 80.0, 31.0, times, [column("illuminance")], [work.condition("illuminance < 1e-9")])
    assert made.outcomes[0].sentence == "not reached"
    never = [mark.event for mark in made.marks if mark.time is None]
    assert sorted(set(never)) == sorted(never) and "sunset" in never


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("V", "is not QUANTITY"), ("V > dark", "'dark' is not a number"), ("Vx > 3", "'Vx' is not known"),
     ("illuminance@zenith > 3", "of a surface"), ("V@up > 3", "is none of zenith")],
)  # fmt: skip
def test_a_condition_that_is_none_is_refused(text, sentence):
    """A misspelt condition would never be met."""
    with pytest.raises(TwilightError, match=sentence):
        work.condition(text)


def test_steps_and_rows_are_checked():
    """A table of a million rows would be begun."""
    assert work.step_of("90s") == timedelta(seconds=90) and work.step_of("0.5h") == timedelta(minutes=30)
    for text in ("1", "0s", "2 days", "-1min"):
        with pytest.raises(TwilightError, match="is not a duration"):
            work.step_of(text)
    now = datetime(2026, 1, 1, tzinfo=UTC)
    with pytest.raises(TwilightError, match="is not after"):
        work.rows(now, now, timedelta(minutes=1))
    with pytest.raises(TwilightError, match="rows; allowed is 2 to"):
        work.rows(now, now + timedelta(days=9), timedelta(seconds=1))


def test_every_preset_has_columns_conditions_and_a_source():
    """A preset would be of nobody."""
    for preset in PRESETS.values():
        assert [column(text) for text in preset.columns] and [work.condition(text) for text in preset.conditions]
        assert any(f"({year}" in preset.about or f" {year}" in preset.about for year in range(1940, 2030))


def test_shades_begin_with_the_twilights_between_the_rows():
    """Rows an hour apart: sunset and dusks within two minutes of those of `twilight times`, for the sun's arc bends."""
    start = datetime(2026, 3, 20, 17, 0, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=6), timedelta(hours=1))
    made = work.timeline(Slope(), *PLACE, times, [column("luminance")])
    marks = {mark.event: mark.time for mark in made.marks}
    found = shades(made)
    assert [depth for *_, depth in found] == [1, 2, 3, 4] and found[-1][1] == times[-1]
    for (first, *_), event in zip(found, ("sunset", "civil dusk", "nautical dusk", "astronomical dusk"), strict=True):
        assert abs((first - marks[event]).total_seconds()) < 120.0


def test_files_hold_what_the_table_holds(tmp_path):
    """CSV and NetCDF would differ."""
    made = work.timeline(Slope(), *PLACE, evening(), [column("V@zenith"), column("CCT")], [work.condition("V > 5")])
    write_table(made, tmp_path / "a.csv", "a test")
    write_dataset(made, tmp_path / "a.nc", {"title": "a test"})
    draw(made, tmp_path / "a.png", "a test")
    _, head, *rows = (tmp_path / "a.csv").read_text().splitlines()
    assert head == (
        "time,sun_elevation_deg,magnitude_V_per_arcsec2_zenith,cct_k,moon_elevation_deg,moon_illuminated_fraction"
    ) and len(rows) == len(made.times)
    with xarray.open_dataset(tmp_path / "a.nc") as data:
        assert np.allclose(data.magnitude_V_per_arcsec2_zenith, made.values[0]) and data.cct_k.attrs["units"] == "K"
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_clocks_of_crossings_do_not_overlap(tmp_path):
    """Thresholds so near to each other that their times would stand on one another."""
    from matplotlib.figure import Figure

    from twilight.studies.timeline_files import _label

    panel = Figure(figsize=(8.0, 2.5)).subplots()
    start = datetime(2026, 3, 20, 18, 0, tzinfo=UTC)
    panel.set_xlim(start, start + timedelta(hours=16))
    panel.set_ylim(0.0, 10.0)
    _label(panel, [(start + timedelta(minutes=8 * i), 5.0 + 0.1 * i) for i in range(6)])
    boxes = [text.get_window_extent() for text in panel.texts]
    assert len(boxes) == 6
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_the_moon_is_named_where_a_threshold_is_not_reached_for_it():
    """A moonlit night would be called too bright without a reason."""

    class Moonlit(Slope):
        def directions(self, moments, elevation, azimuth, sources=None):
            moon = 1.0 if sources is None or "moon" in sources else 0.0
            return super().directions(moments, elevation, azimuth) + moon

    start = datetime(2026, 3, 31, 20, 0, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=6), timedelta(minutes=30))
    unit = float(column("luminance@zenith").values(Slope(), work.moments_at([28.3], [-16.5], times[:1]))[0])
    unit /= float(np.exp(sun_position(times[0], *PLACE).elevation_deg))
    wanted = [work.condition(f"luminance < {level * unit!r}") for level in (0.5, 1e-40)]
    made = work.timeline(Moonlit(), *PLACE, times, [column("luminance")], wanted)
    assert [one.sentence for one in made.outcomes] == ["not reached, for the moon shines", "not reached"]


@pytest.mark.slow
def test_tonight_into_one_file(tmp_path, monkeypatch):
    """Without --at; --output x.csv is that file alone; the solver that was taken is said."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["timeline", "continental-clean", "--latitude", "28.3", "--longitude", "-16.5", "--step", "1h",
              "--quantity", "illuminance", "--output", "night.csv"]
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "solver: compact" in done.stderr and "wrote night.csv" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["night.csv"]
    rows = (tmp_path / "night.csv").read_text().splitlines()
    assert len(rows) == 27 or len(rows) == 26  # noon to noon, 24 hours and some seconds
    assert float(rows[2].split(",")[2]) > 1000.0 > float(rows[14].split(",")[2])


def test_a_condition_that_is_asked_for_twice_is_printed_once(tmp_path):
    """--when would repeat what --for has, and the moon stand in no file."""
    from typer.testing import CliRunner

    from twilight.cli.app import app

    command = [
        "timeline",
        "pure-air",
        "--latitude",
        "28.3",
        "--longitude",
        "-16.5",
        "--at",
        "2026-06-21",
        "--step",
        "2h",
    ]
    command += ["--for", "reading", "--when", "illuminance < 3.4", "--output", str(tmp_path / "a.csv")]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    said = [line for line in result.stdout.splitlines() if line.startswith("illuminance < 3.4")]
    assert len(said) == len(set(said)) and any(line.startswith("moonset") for line in result.stdout.splitlines())
    assert "moon_elevation_deg" in (tmp_path / "a.csv").read_text()
