"""Files of measurements, each in its makers' words: what is taken from them and what is refused."""

import datetime as dt

import air_files
import h5py
import numpy as np
import pytest
import xarray

from twilight.atmosphere.aerosols import optical_depth_at
from twilight.atmosphere.measured import AerosolDepth, AirColumn, OzoneColumn, SizeDistribution, WaterColumn
from twilight.atmosphere.profiles import load_profile
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.io.air import PlaceAndTime, read_air_file
from twilight.scene.medium import climate_medium

WANTED = PlaceAndTime(dt.datetime(2026, 6, 21, 18, 30, tzinfo=dt.UTC), air_files.LATITUDE, air_files.LONGITUDE)
PLACE = {"at": "2026-06-21T18:30+00:00", "latitude_deg": air_files.LATITUDE, "longitude_deg": air_files.LONGITUDE}
SUMMER = load_profile("midlatitude_summer")


def part_of(path, kind, wanted=WANTED):
    return next(part for part in read_air_file(path, wanted).parts if isinstance(part, kind))


def assert_summer(column: AirColumn, rtol: float, ozone: bool):
    """The column is AFGL's midlatitude summer, up to what the format rounds."""
    inside = (column.altitude_km > 0.05) & (column.altitude_km < 49.0)
    there = SUMMER.at(column.altitude_km[inside])
    np.testing.assert_allclose(column.pressure_hpa[inside], there.pressure_hpa, rtol=rtol)
    np.testing.assert_allclose(column.temperature_k[inside], there.temperature_k, atol=0.5)
    low = column.altitude_km[inside] < 10.0
    humid = there.h2o_per_cm3 / there.air_per_cm3
    np.testing.assert_allclose(column.water_vapour[inside][low], humid[low], rtol=0.06)
    if ozone:
        part = there.o3_per_cm3 / there.air_per_cm3
        known = np.isfinite(column.ozone[inside])
        np.testing.assert_allclose(column.ozone[inside][known], part[known], rtol=0.02)
        assert np.all(known[column.altitude_km[inside] > 1.2])


def test_sounding_of_the_university_of_wyoming(tmp_path):
    """A column of the list would be misread."""
    column = part_of(air_files.wyoming(tmp_path / "munich.txt"), AirColumn)
    assert column.source == (
        "sounding munich.txt: 10868 Muenchen-Oberschleissheim, 2026-06-21 12:00 UTC, 0 km and 6.5 h away"
    )
    assert_summer(column, 5e-3, ozone=False)


def test_sounding_of_igra(tmp_path):
    """The sounding of the day; heights that the archive lacks are hydrostatic."""
    path = air_files.igra(tmp_path / "GMM00010868-data.txt")
    column = part_of(path, AirColumn)
    assert "IGRA GMM00010868, 2026-06-21 12:00 UTC" in column.source
    assert_summer(column, 5e-3, ozone=False)
    other = part_of(path, AirColumn, PlaceAndTime(dt.datetime(2026, 6, 22, 9, tzinfo=dt.UTC)))
    np.testing.assert_allclose(other.temperature_k - column.temperature_k, 5.0, atol=0.11)
    with pytest.raises(TwilightError, match="holds 3 soundings, from 2026-06-20 12:00 UTC to 2026-06-22 12:00 UTC"):
        read_air_file(path, PlaceAndTime())


@pytest.mark.parametrize("make", [air_files.era5, air_files.merra2, air_files.grib])
def test_reanalyses(tmp_path, make):
    """A reanalysis would be misread, or its unit be another."""
    if make is air_files.grib:
        pytest.importorskip("cfgrib")
    reading = read_air_file(make(tmp_path / "analysis"), WANTED)
    assert reading.kind == "reanalysis"
    column = next(part for part in reading.parts if isinstance(part, AirColumn))
    assert_summer(column, 3e-3, ozone=True)
    if make is air_files.merra2:
        amounts = {type(part): part for part in reading.parts}
        assert amounts[OzoneColumn].column_du == 331.0 and amounts[WaterColumn].column_mm == 25.0
        depth = amounts[AerosolDepth]
        assert optical_depth_at(depth.wavelength_nm, depth.optical_depth, [550.0])[0] == pytest.approx(0.21)
        assert column.altitude_km[0] > 0.1  # the lowest level is under the ground and missing
        assert any("clouds (QL)" in words for words in reading.not_used)  # water without the fraction that it covers


def test_maps_are_interpolated_in_place_and_time(tmp_path):
    """Air would be of the next grid point or hour."""
    path = air_files.era5(tmp_path / "a.nc", slope_k=4.0)  # 4 K in an hour
    times = [WANTED.time + dt.timedelta(minutes=m) for m in (-30, 0, 15)]
    hours = [part_of(path, AirColumn, PlaceAndTime(time, 48.25, 11.5)) for time in times]
    np.testing.assert_allclose(hours[1].temperature_k - hours[0].temperature_k, 2.0, atol=1e-6)
    np.testing.assert_allclose(hours[2].temperature_k - hours[1].temperature_k, 1.0, atol=1e-6)
    lat, lon = np.arange(90.0, -91.0, -30.0), np.arange(0.0, 360.0, 30.0)
    field = 300.0 + 0.5 * lat[:, None] + 10.0 * np.cos(np.radians(lon))
    xarray.Dataset(
        {"tco3": (("latitude", "longitude"), field * 2.1415e-5)}, {"latitude": lat, "longitude": lon}
    ).to_netcdf(tmp_path / "globe.nc", engine="h5netcdf")

    def column(latitude, longitude):
        return part_of(tmp_path / "globe.nc", OzoneColumn, PlaceAndTime(None, latitude, longitude)).column_du

    assert column(15.0, 90.0) == pytest.approx(307.5, abs=0.01)
    between = pytest.approx(300.0 + 5.0 * (1.0 + np.cos(np.radians(30))), abs=0.01)
    assert column(0.0, -15.0) == column(0.0, 345.0) == between
    times = r"valid_time goes from 2026-06-21 18:00 UTC to 2026-06-21 19:00 UTC, and 2026"
    with pytest.raises(TwilightError, match=times):
        read_air_file(path, PlaceAndTime(dt.datetime(2026, 6, 22, tzinfo=dt.UTC), 48.25, 11.5))
    with pytest.raises(TwilightError, match=r"latitude goes from 48 to 48.5 deg, and 52 is asked for"):
        read_air_file(path, PlaceAndTime(WANTED.time, 52.0, 11.5))
    with pytest.raises(TwilightError, match="holds a map; say where"):
        read_air_file(path, PlaceAndTime(WANTED.time))


def test_columns_of_cams(tmp_path):
    """Ozone or haze of CAMS would be in another unit."""
    reading = read_air_file(air_files.cams(tmp_path / "cams.nc"), WANTED)
    depth = next(part for part in reading.parts if isinstance(part, AerosolDepth))
    np.testing.assert_allclose(depth.wavelength_nm, [469, 550, 670, 865, 1240])
    np.testing.assert_allclose(depth.optical_depth, [0.30, 0.25, 0.19, 0.13, 0.08])
    # 2.1415e-5 kg m^-2 in a Dobson unit, as ECMWF has it
    assert part_of(tmp_path / "cams.nc", OzoneColumn).column_du == pytest.approx(320.0, abs=0.05)
    with xarray.open_dataset(tmp_path / "cams.nc", engine="scipy") as data:
        (data * np.nan).to_netcdf(tmp_path / "empty.nc", engine="scipy")
    with pytest.raises(TwilightError, match="allowed is a number from 50 to 700 DU"):
        read_air_file(tmp_path / "empty.nc", WANTED)


def test_optical_depths_of_aeronet(tmp_path):
    """Haze of AERONET would be of other channels or times."""
    path = air_files.aeronet(tmp_path / "a.lev15")
    depth = part_of(path, AerosolDepth)
    assert "Munich_University, 2026-06-21 18:10 UTC, 11 km and 0.3 h away" in depth.source
    nm = sorted(air_files.AOD)
    np.testing.assert_allclose(depth.wavelength_nm, [500.3 if w == 500 else w for w in nm])  # the filter's own
    np.testing.assert_allclose(depth.optical_depth, [air_files.AOD[w] + 0.02 for w in nm])
    assert part_of(path, WaterColumn).column_mm == pytest.approx(21.0)
    # a single channel goes on with the row's exponent
    one = part_of(air_files.aeronet(tmp_path / "one.lev15", {500: 0.2}, exponent=1.5), AerosolDepth)
    assert optical_depth_at(one.wavelength_nm, one.optical_depth, [1000.6])[0] == pytest.approx(0.22 * 2.0**-1.5)


def test_an_inversion_is_an_aerosol_of_its_own(tmp_path):
    """The narrow modes that stand for its bins have its volume, and its extinction by Mie theory."""
    path = air_files.inversion(tmp_path / "a.all")
    sizes = part_of(path, SizeDistribution)
    np.testing.assert_allclose(sizes.index, [1.45 - 0.008j, 1.45 - 0.007j, 1.46 - 0.007j, 1.46 - 0.007j])
    climate = load({"version": 1, "climate": {"version": 1, "air": {"aeronet": str(path), **PLACE}}}).climate
    modes = climate.aerosol.modes
    per_um2 = np.array([m.number_density_per_cm3 for m in modes]) * 2e5 * 1e-8
    median, width = np.array([m.median_radius_um for m in modes]), np.log([m.sigma for m in modes])
    volume = np.sum(per_um2 * 4.0 / 3.0 * np.pi * median**3 * np.exp(4.5 * width**2))
    # of the two log-normal modes that the file was made from, between its outermost radii
    assert volume == pytest.approx(0.05 + 0.03, rel=0.02)
    medium = climate_medium(climate, np.array([440.0, 675.0, 870.0]))
    np.testing.assert_allclose(medium.optical_depth("aerosol"), [0.27, 0.15, 0.11], rtol=1e-6)
    assert 0.9 < medium.aerosol_single_scattering_albedo[0, 0] < 0.97
    assert "inversion" in climate.air.sources["aerosol sizes and index"]


def test_clouds_of_a_reanalysis(tmp_path):
    """Layers where the sky is covered, with the optical depth of their water; what covers little is clear."""
    path = air_files.era5(tmp_path / "c.nc", clouds=True)
    climate = load("pure-air", {"air": {"reanalysis": str(path), **PLACE}}).climate
    low, high = climate.clouds
    assert (low.kind, high.kind) == ("stratus", "cirrus") and "20 %" not in climate.air.sources["clouds"]
    # levels of 850 to 750 hPa stand for 862.5 to 725: 137.5 hPa of air with 0.1 g in a kg, droplets of 7.33 um
    assert low.optical_depth == pytest.approx(1.5 * 1e-4 * 13750.0 / 9.80665 / (1000.0 * 7.33e-6), rel=1e-3)
    assert high.optical_depth == pytest.approx(1.5 * 2e-5 * 8750.0 / 9.80665 / (917.0 * 91.7e-6), rel=1e-3)
    z = SUMMER.at(np.linspace(0.0, 12.0, 1201))
    edges = np.interp([-862.5, -725.0], -z.pressure_hpa, z.altitude_km)
    np.testing.assert_allclose([low.base_km, low.top_km], edges, atol=0.05)
    clear = load("pure-air", {"air": {"reanalysis": str(air_files.era5(tmp_path / "d.nc")), **PLACE}}).climate
    assert not clear.clouds and clear.air.sources["clouds"] == "the climate's own, none"


BROKEN = [
    (air_files.wyoming, {" 902.0": " 90x.0"}, r"line 10: PRES is `90x.0`, allowed is a number from 0.001"),
    (air_files.wyoming, {"Observations at 12Z": "", "Observation time": ""}, "line 6: the sounding has no time"),
    (air_files.igra, {"21 -9999 101300": "21 -9999 1o1300"}, r"line 32: PRESS \(columns 10 to 15\) is `1o1300`"),
    (air_files.igra, {"12 1045   29": "12 1045   27"}, r"line 29: `20 .* is no header of a sounding"),
    (air_files.aeronet, {"0.250000": "2.3e9"}, r"line 10: AOD_500nm is `2.3e9`, allowed is a number from -0.1"),
    (air_files.aeronet, {"21:06:2026": "2026-06-21"}, r"line 8: .* is no time such as 21:06:2026"),
    (air_files.aeronet, {"AOD_": "XYZ_"}, "line 7: has no column AOD_"),
    (air_files.aeronet, {"AERONET": "ANTENNE"}, "none of the files that are read: a sounding"),
]
"""Files, words in them with what stands in their place, and what is said."""


@pytest.mark.parametrize(("make", "change", "words"), BROKEN)
def test_a_broken_text_is_one_sentence(tmp_path, make, change, words):
    """A slip in a text would be air."""
    path = make(tmp_path / "broken")
    text = path.read_text()
    for old, new in change.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    with pytest.raises(TwilightError, match=words) as caught:
        read_air_file(path, WANTED)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("make", [air_files.wyoming, air_files.igra, air_files.aeronet])
def test_a_damaged_text_is_read_or_refused(tmp_path, make):
    """Bytes that are changed, cut out or doubled: a part of the air, or a sentence, and never anything else."""
    whole, path = make(tmp_path / "whole").read_bytes(), tmp_path / "damaged"
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(40):
        data = bytearray(whole)
        at, other, length = (int(x) for x in rng.integers(1, [len(data), len(data), 200]))
        if (kind := rng.integers(3)) == 0:
            data[at : at + length] = rng.integers(0, 256, length // 20 + 1).astype(np.uint8).tobytes()
        elif kind == 1:
            del data[at:]
        else:
            data[at:at] = data[other : other + length]
        path.write_bytes(data)
        try:
            assert read_air_file(path, WANTED).parts
        except TwilightError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 0


def test_a_broken_map_is_one_sentence(tmp_path):
    """A download cut off would be a traceback."""
    whole = air_files.era5(tmp_path / "a.nc").read_bytes()
    (tmp_path / "half.nc").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "old.hdf").write_bytes(b"\x0e\x03\x13\x01" + bytes(99))
    (tmp_path / "bad.grib").write_bytes(b"GRIB" + bytes(99))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["radiance"] = np.ones(3)
    no_height = air_files.era5(tmp_path / "b.nc", z=None)
    for path, words in (
        (tmp_path / "half.nc", "not a complete netCDF file"),
        (tmp_path / "empty", "none of the files"),
        (tmp_path / "old.hdf", "HDF4"),
        (tmp_path / "bad.grib", "not a complete GRIB file"),
        (tmp_path / "other.h5", "has no latitude and longitude"),
        (no_height, "download z"),
        (tmp_path, "is a folder"),
    ):
        with pytest.raises(TwilightError, match=words):
            read_air_file(path, WANTED)


def test_grib_asks_for_its_package(tmp_path, monkeypatch):
    """A GRIB without its package would be a traceback."""
    import sys

    monkeypatch.setitem(sys.modules, "cfgrib", None)
    (tmp_path / "e.grib").write_bytes(b"GRIB")
    with pytest.raises(TwilightError, match="install 'cfgrib>="):
        read_air_file(tmp_path / "e.grib", WANTED)
