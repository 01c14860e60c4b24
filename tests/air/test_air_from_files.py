"""Climates made of files of measurements: the command, the section `air`, and the sky that they give."""

import air_files
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.config.load import load_climate
from twilight.engine import solve
from twilight.scene import resolve
from twilight.scene.medium import climate_medium
from twilight.scene.scene import resolved_configuration

PLACE = {"at": "2026-06-21T18:30+00:00", "latitude_deg": air_files.LATITUDE, "longitude_deg": air_files.LONGITUDE}
ASKED = ["--at", "2026-06-21T18:30Z", "--latitude", str(air_files.LATITUDE), "--longitude", str(air_files.LONGITUDE)]


def run(*arguments):
    return CliRunner().invoke(app, ["climate", "from", *map(str, arguments)])


def test_the_command_prints_a_climate_and_says_what_is_from_where(tmp_path, monkeypatch):
    """The climate would not say what was measured."""
    monkeypatch.chdir(tmp_path)
    made = [air_files.wyoming(tmp_path / "w.txt"), air_files.era5(tmp_path / "e.nc")]
    made += [air_files.aeronet(tmp_path / "a.lev15"), air_files.cams(tmp_path / "cams.nc")]
    result = run(*made, *ASKED)
    assert result.exit_code == 0, result.output
    (tmp_path / "mine.yaml").write_text(result.stdout)
    climate = load_climate(tmp_path / "mine.yaml")
    sources = climate.air.sources
    assert sources["pressure and temperature"].startswith("to 30 km sounding w.txt")
    assert all(words in sources["pressure and temperature"] for words in ("above to 49", "climate's own"))
    assert sources["ozone column"].startswith("320 DU, map cams.nc")
    assert climate.gases.ozone.column_du == pytest.approx(320.0, abs=0.05)
    assert sources["aerosol sizes and index"] == "the climate's own, continental_average"
    assert "water vapour, 21 mm" in sources["not used"]
    for name, words in sources.items():
        assert f"{name}: {words}" in result.stderr
    assert yaml.safe_load(result.stdout)["atmosphere"]["levels"]["pressure_hpa"][0] == pytest.approx(1013.0, abs=0.2)
    described = CliRunner().invoke(app, ["show", "mine.yaml", "--output", "p.png"])
    assert described.exit_code == 0 and "source of humidity" in described.stdout


def test_the_climate_of_an_inversion_is_read_back(tmp_path):
    """Twenty-two modes of one index: nothing in the document points to something else in it."""
    result = run(air_files.inversion(tmp_path / "v.all"), *ASKED)
    assert result.exit_code == 0, result.output
    (tmp_path / "mine.yaml").write_text(result.stdout)
    aerosol = load_climate(tmp_path / "mine.yaml").aerosol
    assert len(aerosol.modes) == 22 and aerosol.modes[3].refractive_index == aerosol.modes[7].refractive_index
    # layer and scale height of the base's type stay
    assert (aerosol.boundary_layer_top_km, aerosol.scale_height_km) == (2.0, 8.0)


def test_the_section_air_reads_beside_its_file_and_its_record_needs_no_files(tmp_path):
    """Paths count from the climate's folder, the place is the sun's; its record gives the same air without them."""
    air_files.wyoming(tmp_path / "w.txt")
    air_files.aeronet(tmp_path / "a.lev15")
    (tmp_path / "munich.yaml").write_text(
        "version: 1\nname: munich\naerosol: {type: continental_average}\nair: {sounding: w.txt, aeronet: [a.lev15]}\n"
    )
    sun = {"at": "2026-06-21T20:30", "latitude_deg": 48.25, "longitude_deg": 11.55, "time_zone": "Europe/Berlin"}
    config = load(tmp_path / "munich.yaml", {"sun": sun})
    climate = config.climate
    assert not climate.air.asks and climate.atmosphere.levels is not None
    assert climate.gases.ozone.column_du == pytest.approx(338.0, abs=3.0)  # 45 to 55 N in June
    record = resolved_configuration(config, config.sun)
    for file in tmp_path.iterdir():
        file.unlink()
    again = load(record).climate
    assert again.air.sources == climate.air.sources
    wavelength = np.array([450.0, 650.0])
    first, second = climate_medium(climate, wavelength), climate_medium(again, wavelength)
    np.testing.assert_array_equal(first.absorption_per_km, second.absorption_per_km)
    np.testing.assert_array_equal(first.aerosol_extinction_per_km, second.aerosol_extinction_per_km)


@pytest.mark.parametrize(("air", "words"), [({"sounding": "a.lev15", **PLACE}, "; air.sounding takes a sounding")])
def test_the_section_air_refuses_in_one_sentence(tmp_path, air, words):
    """A photometer's file would be read as a sounding."""
    air_files.aeronet(tmp_path / "a.lev15")
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({"version": 1, "name": "c", "air": air}))
    with pytest.raises(TwilightError, match=words):
        load(tmp_path / "c.yaml")


def test_the_sky_of_an_atmosphere_written_as_files_is_that_of_the_atmosphere(coarse_draft, tmp_path):
    """AFGL's summer as a sounding and a reanalysis, with the digits that these have: the radiance comes back."""
    air_files.wyoming(tmp_path / "w.txt")
    air_files.era5(tmp_path / "e.nc")
    common = {
        "wavelengths": {"list_nm": [450.0, 550.0, 600.0]}, "solver.quality": "draft", "solver.polarisation": False,
        "omit_negligible": False, "gases.water_vapour.column_mm": 0.0, "gases.ozone.climatology": False,
    }  # fmt: skip
    air = {"sounding": str(tmp_path / "w.txt"), "reanalysis": str(tmp_path / "e.nc"), **PLACE}
    elevation, azimuth = np.array([3.0, 10.0, 30.0, 90.0, 10.0]), np.array([0.0, 0.0, 90.0, 0.0, 180.0])
    skies = []
    for more in ({}, {"air": air}):
        field = solve(resolve(load("pure-air", {**common, **more, "sun.elevation_deg": -4.0})), [5.0, -4.0])
        skies.append(np.stack([field.radiance(sun, elevation, azimuth) for sun in (5.0, -4.0)]))
    assert np.max(np.abs(skies[1] / skies[0] - 1.0)) < 0.003


def test_files_of_other_air_than_the_base_bring_their_own(tmp_path):
    """A subarctic winter over a base of summer: its ozone, its water, its cold."""
    air_files.wyoming(tmp_path / "w.txt", "subarctic_winter")
    air_files.era5(tmp_path / "e.nc", "subarctic_winter")
    air = {"sounding": str(tmp_path / "w.txt"), "reanalysis": str(tmp_path / "e.nc"), **PLACE}
    notes = climate_medium(load("pure-air", {"air": air}).climate, np.array([550.0])).notes
    winter = climate_medium(load("pure-air", {"atmosphere.profile": "subarctic_winter"}).climate, np.array([550.0]))
    assert notes["ozone_column_du"] == pytest.approx(winter.notes["ozone_column_du"], rel=0.02)
    assert notes["water_vapour_column_mm"] == pytest.approx(winter.notes["water_vapour_column_mm"], rel=0.03)
    air_depth, wanted = notes["optical_depth"]["air"][0], winter.notes["optical_depth"]["air"][0]
    assert air_depth == pytest.approx(wanted, rel=1e-3)
