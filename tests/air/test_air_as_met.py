"""Files of measurements in the shapes that services hand out today: axes, versions, runs, places, and what is far."""

import datetime as dt
import warnings
import zipfile

import air_files
import numpy as np
import pytest
import xarray

from twilight.atmosphere import measured
from twilight.atmosphere.measured import AerosolDepth, AirColumn
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config import load
from twilight.io.air import PlaceAndTime, read_air_file

TIME = dt.datetime(2026, 6, 21, 18, 30, tzinfo=dt.UTC)
WANTED = PlaceAndTime(TIME, air_files.LATITUDE, air_files.LONGITUDE)


def part_of(path, kind, wanted=WANTED):
    return next(part for part in read_air_file(path, wanted).parts if isinstance(part, kind))


@pytest.fixture(scope="module")
def era5(tmp_path_factory):
    path = air_files.era5(tmp_path_factory.mktemp("era5") / "a.nc", slope_k=4.0)
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        return data.load().drop_vars("expver"), part_of(path, AirColumn)


def save(data, path):
    data.to_netcdf(path, engine="h5netcdf")
    return path


def assert_same(one, other, rtol=1e-9):
    for name in ("altitude_km", "pressure_hpa", "temperature_k", "water_vapour", "ozone"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=rtol)


def test_versions_are_merged_before_they_are_interpolated(tmp_path, era5):
    """ERA5 with expver: the last final hour and the first preliminary one, each missing in the other version."""
    data, expected = era5
    last = data["valid_time"] == data["valid_time"][0]
    both = xarray.concat([data.where(last), data.where(~last)], dim=xarray.Variable("expver", [1, 5]))
    assert_same(part_of(save(both, tmp_path / "b.nc"), AirColumn), expected)


def test_runs_of_a_forecast(tmp_path, era5):
    """Two axes of time: the time that a field is for counts, of several runs the last one."""
    data, expected = era5
    times = data["valid_time"].values
    start = times[0] - np.array([12, 6], "timedelta64[h]")
    steps = np.array([6, 7, 12, 13], "timedelta64[h]").astype("timedelta64[ns]")
    runs = []
    for i, first in enumerate(start):
        valid = first + steps
        index = [int(np.argmin(np.abs(times - v))) for v in valid]
        run = data.isel(valid_time=index).drop_vars("valid_time").rename(valid_time="forecast_period")
        right = np.isin(valid, times) & (i == 1) | ~np.isin(valid, times)
        run = run + xarray.DataArray(np.where(right, 0.0, 50.0), dims="forecast_period")  # an older run is worse
        runs.append(run.assign_coords(forecast_period=steps))
    whole = xarray.concat(runs, dim=xarray.Variable("forecast_reference_time", start))
    assert_same(part_of(save(whole, tmp_path / "no_valid_time.nc"), AirColumn), expected)
    for dims in (("forecast_reference_time", "forecast_period"), ("forecast_period", "forecast_reference_time")):
        valid = start[:, None] + steps
        valid = valid if dims[0] == "forecast_reference_time" else valid.T
        given = whole.assign_coords(valid_time=(dims, valid)).transpose(*dims, ...)
        assert_same(part_of(save(given, tmp_path / f"{dims[0]}.nc"), AirColumn), expected)


def test_the_time_of_a_single_step_is_said_and_checked(tmp_path, era5):
    """Air of another day would be taken without a word."""
    data, _ = era5
    path = save(data.isel(valid_time=[0]), tmp_path / "a.nc")
    assert "2026-06-21 18:00 UTC, 0.5 h away" in part_of(path, AirColumn).source
    later = PlaceAndTime(TIME + dt.timedelta(days=3), air_files.LATITUDE, air_files.LONGITUDE)
    (words,) = read_air_file(path, later).warnings
    assert "more than 12 h" in words and "72.5 h away" in words


def test_an_axis_too_many_is_named(tmp_path, era5):
    """Members of an ensemble would be mixed."""
    data, _ = era5
    members = data.drop_vars("number").expand_dims(number=3)
    with pytest.raises(TwilightError, match=r"(t|z|q|o3) still has the dimension number \(3 of them\).*choose one"):
        read_air_file(save(members, tmp_path / "a.nc"), WANTED)
    with pytest.raises(TwilightError, match=r"is on model levels \(hybrid\); download it on pressure levels"):
        read_air_file(save(data.rename(pressure_level="hybrid"), tmp_path / "b.nc"), WANTED)


def test_a_geopotential_of_the_ground_alone(tmp_path, era5):
    """With the pressure there the heights are hydrostatic; without it a sentence says what to download."""
    data, expected = era5
    ground_m = 300.0
    flat = data.drop_vars("z")
    flat["z"] = data["t"].isel(pressure_level=0) * 0.0 + ground_m * measured.STANDARD_GRAVITY
    with pytest.raises(TwilightError, match=r"that of the ground alone; download z .* on the pressure levels"):
        read_air_file(save(flat, tmp_path / "a.nc"), WANTED)
    altitude = measured.geopotential_km(expected.altitude_km, WANTED.latitude_deg) * 1e3
    pressure = np.exp(np.interp(ground_m, altitude, np.log(expected.pressure_hpa)))
    flat["sp"] = flat["z"] * 0.0 + 100.0 * pressure
    found = part_of(save(flat, tmp_path / "b.nc"), AirColumn)
    low = expected.altitude_km < 30.0
    np.testing.assert_allclose(found.altitude_km[low], expected.altitude_km[low], rtol=5e-3, atol=0.02)


def test_a_zip_with_one_netcdf(tmp_path, era5):
    """A download as it comes would be refused."""
    data, expected = era5
    save(data, tmp_path / "a.nc")
    with zipfile.ZipFile(tmp_path / "b.nc", "w") as archive:
        archive.write(tmp_path / "a.nc", "data_stream-oper.nc")
    assert_same(part_of(tmp_path / "b.nc", AirColumn), expected)
    with zipfile.ZipFile(tmp_path / "b.nc", "a") as archive:
        archive.write(tmp_path / "a.nc", "other.nc")
    with pytest.raises(TwilightError, match=r"holds 2 files \(data_stream-oper.nc, other.nc\).*unpack it"):
        read_air_file(tmp_path / "b.nc", WANTED)
    with zipfile.ZipFile(tmp_path / "c.nc", "w") as archive:
        archive.writestr("half.nc", (tmp_path / "a.nc").read_bytes()[:9000])
    with pytest.raises(TwilightError, match=r"c.nc: is not a complete netCDF file"):
        read_air_file(tmp_path / "c.nc", WANTED)


# Soundings and photometers

LEVELS = [(1000.0, 100, 20.0, 10.0, 52), (850.0, 1500, 10.0, 2.0, 58), (500.0, 5700, -15.0, -30.0, 26)]


def wyoming_html(path):
    rows = "".join(f"{p:7.1f}{h:7d}{t:7.1f}{d:7.1f}{r:7d}   5.00\n" for p, h, t, d, r in LEVELS)
    path.write_text(
        "<HTML><BODY>\n<H1>Observations for Station 10868 at 12 UTC 21 Jun 2026</H1>\n<PRE>\n"
        "   PRES   HGHT   TEMP   DWPT   RELH   MIXR\n    hPa      m      C      C      %   g/kg\n" + "-" * 77 + "\n"
        f"{rows}</PRE>\n<TR><TD>SLAT</TD><TD>Station Latitude</TD><TD>48.25</TD><TD>degrees_north</TD></TR>\n"
        "<TR><TD>SLON</TD><TD>Station Longitude</TD><TD>11.55</TD><TD>degrees_east</TD></TR>\n</BODY></HTML>\n"
    )
    return path


def wyoming_csv(path, levels=LEVELS):
    rows = "".join(f"2026-06-21 12:00:00,11.55,48.25,{p},{h},{t},{d},,{r},,5.0,210,3\n" for p, h, t, d, r in levels)
    path.write_text(
        "time,longitude,latitude,pressure_hPa,geopotential height_m,temperature_C,dew point temperature_C,"
        "ice point temperature_C,relative humidity_%,humidity wrt ice_%,mixing ratio_g/kg,wind direction_degree,"
        f"wind speed_m/s\n{rows}"
    )
    return path


@pytest.mark.parametrize("make", [wyoming_html, wyoming_csv])
def test_soundings_as_wyoming_hands_them_out(tmp_path, make):
    """A sounding of today's page would be misread."""
    column = part_of(make(tmp_path / "a"), AirColumn)
    assert "2026-06-21 12:00 UTC, 0 km and 6.5 h away" in column.source
    np.testing.assert_allclose(column.pressure_hpa, [1000.0, 850.0, 500.0])
    np.testing.assert_allclose(column.temperature_k, [293.15, 283.15, 258.15])
    np.testing.assert_allclose(column.altitude_km, [0.1, 1.5, 5.7], atol=0.01)
    assert column.water_vapour[0] == pytest.approx(12.27 / 1000.0, rel=0.01)


def test_a_csv_of_seconds_is_thinned(tmp_path):
    """Five thousand levels would make every step slow."""
    p = np.geomspace(1000.0, 10.0, 5000)
    levels = [(f"{x:.3f}", round(-7000 * np.log(x / 1000)), 0.0, -5.0, 60) for x in p]
    column = part_of(wyoming_csv(tmp_path / "a", levels), AirColumn)
    assert 250 < column.pressure_hpa.size <= 300 and column.pressure_hpa[[0, -1]] == pytest.approx([1000.0, 10.0])
    with pytest.raises(TwilightError, match=r"line 2: pressure_hPa is `x`, allowed is a number from 0.001 to 1100"):
        read_air_file(wyoming_csv(tmp_path / "b", [("x", 1, 1.0, 1.0, 1)]), WANTED)


def aeronet(path, *rows, head="AERONET Version 3;\n", end=""):
    names = "AERONET_Site,Date(dd:mm:yyyy),Time(hh:mm:ss),AOD_500nm,440-870_Angstrom_Exponent,Site_Latitude(Degrees),"
    lines = [f"{site},21:06:2026,{at}:00,{depth},1.3,{lat},{lon}{end}" for site, at, depth, lat, lon in rows]
    path.write_text(f"{head}Version 3: AOD Level 1.5\n{names}Site_Longitude(Degrees){end}\n" + "\n".join(lines) + "\n")
    return path


NEAR, FAR = ("Near", "17:31", 0.1, 48.2, 11.5), ("Far", "18:30", 1.9, 23.0, 5.5)


def test_nearest_is_first_in_place_then_in_time(tmp_path):
    """Haze of another place would be taken."""
    path = aeronet(tmp_path / "a.lev15", FAR, NEAR, ("Near", "10:00", 0.3, 48.2, 11.5))
    depth = part_of(path, AerosolDepth)
    assert depth.optical_depth[0] == 0.1 and "Near, 2026-06-21 17:31 UTC" in depth.source
    with pytest.raises(TwilightError, match="holds measurements of several places; say where"):
        read_air_file(path, PlaceAndTime(TIME))
    assert read_air_file(aeronet(tmp_path / "b", NEAR), PlaceAndTime(TIME)).parts


@pytest.mark.parametrize(("head", "end"), [("AERONET Data Download (Version 3 Direct Sun)\nAERONET Version 3;\n", ""),
                                           ("<html>\n\nAERONET Version 3;<br>\n", "<br>")])  # fmt: skip
def test_aeronets_web_service(tmp_path, head, end):
    """More lines on top, and line ends of a page."""
    depth = part_of(aeronet(tmp_path / "a.txt", NEAR, head=head, end=end), AerosolDepth)
    assert depth.optical_depth[0] == 0.1 and "Near" in depth.source


def test_every_way_in_warns_of_what_is_far(tmp_path):
    """A scene that is loaded to be rendered, as the climate of a place that is printed."""
    aeronet(tmp_path / "far.lev15", FAR)
    scene = {
        "version": 1,
        "climate": {"version": 1, "air": {"aeronet": str(tmp_path / "far.lev15")}},
        "sun": {"at": "2026-06-23T21:00+02:00", "latitude_deg": 48.1, "longitude_deg": 11.5},
    }
    for _ in range(2):  # also where the file was read before
        with pytest.warns(TwilightWarning, match=r"Far, .* more than 300 km and more than 12 h from the place"):
            load(scene)
    scene["sun"] |= {"at": "2026-06-21T21:00+02:00", "latitude_deg": 23.0, "longitude_deg": 5.5}
    with warnings.catch_warnings():
        warnings.simplefilter("error", TwilightWarning)
        load(scene)


def in_units(data, name, factor, unit):
    """A variable or a coordinate in another unit, said or not."""
    return data.assign({name: (data[name].dims, data[name].values * factor, {"units": unit})})


@pytest.mark.parametrize(
    "change",
    [
        lambda data: in_units(data, "pressure_level", 100.0, "Pa").rename(pressure_level="isobaricInPa"),
        lambda data: in_units(data, "pressure_level", 0.1, "kPa").isel(pressure_level=slice(None, None, -1)),
        lambda data: data.isel(latitude=slice(None, None, -1)).rename(valid_time="time", latitude="lat"),
        lambda data: data.assign_coords(
            p=("pressure_level", data.pressure_level.values, {"standard_name": "air_pressure", "units": "hPa"})
        ).swap_dims(pressure_level="p").drop_vars("pressure_level"),
        lambda data: xarray.concat([data + 1.0, data], dim=xarray.Variable("expver", ["0005", "0001"])),
    ],
)  # fmt: skip
def test_one_map_in_every_dress(tmp_path, era5, change):
    """Names, orders and units of axes as services and tools write them; of two versions the final one counts."""
    data, expected = era5
    assert_same(part_of(save(change(data), tmp_path / "a.nc"), AirColumn), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: in_units(data, "pressure_level", 750.0, "mmHg"), "in 'mmHg'; allowed are hPa, Pa"),
        (lambda data: in_units(data, "z", 1 / 9.8, "m"), r"has 5.01 km of air .* make 49.1 km"),
        (
            lambda data: in_units(data, "q", 1e3, "g kg**-1"),
            "specific humidity goes from .* allowed is -0.01 to 0.1 kg",
        ),
        (lambda data: data.isel(pressure_level=0, drop=True), "t is that of one level"),
        (lambda data: data.rename(pressure_level="levels"), "pressure levels are known by its name"),
        (lambda data: data.assign_coords(valid_time=[0.0, 1.0]), "valid_time is no time of the usual calendar"),
    ],
)
def test_maps_that_are_refused(tmp_path, era5, change, message):
    """A map in another unit would be air."""
    with pytest.raises(TwilightError, match=message):
        read_air_file(save(change(era5[0]), tmp_path / "a.nc"), WANTED)


def test_a_map_of_one_far_place_is_warned_of(tmp_path, era5):
    """Air of a far place would be taken without a word."""
    path = save(era5[0].isel(latitude=1, longitude=1), tmp_path / "a.nc")
    assert not read_air_file(path, WANTED).warnings
    (words,) = read_air_file(path, PlaceAndTime(TIME, 10.0, 20.0)).warnings
    assert "48.25 N 11.5 E" in words and "more than 300 km" in words


TEXT_DRESSES = {
    "CRLF": lambda b: b.replace(b"\n", b"\r\n"),
    "mark": lambda b: b"\xef\xbb\xbf" + b,
    "UTF-16": lambda b: b.decode().encode("utf-16"),
    "notes on top": lambda b: b"# downloaded by me\n\n" + b,
}


@pytest.mark.parametrize("dress", TEXT_DRESSES.values(), ids=TEXT_DRESSES)
@pytest.mark.parametrize("make", [wyoming_html, wyoming_csv, air_files.igra, air_files.aeronet])
def test_one_text_in_every_dress(tmp_path, make, dress):
    """A file saved by another editor would be refused or misread."""
    path = make(tmp_path / "a")
    plain = read_air_file(path, WANTED).parts[0]
    path.write_bytes(dress(path.read_bytes()))
    found = read_air_file(path, WANTED).parts[0]
    name = "optical_depth" if isinstance(plain, AerosolDepth) else "temperature_k"
    assert found.source == plain.source
    np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))


@pytest.mark.parametrize("word", ["", "NaN", "-9999", "-999.0", "N/A", "null", "////"])
def test_missing_numbers(tmp_path, word):
    """A level without a temperature is left out, whatever stands in its place."""
    levels = [LEVELS[0], (925.0, 800, word, word, word), *LEVELS[1:]]
    column = part_of(wyoming_csv(tmp_path / "a", levels), AirColumn)
    np.testing.assert_allclose(column.pressure_hpa, [1000.0, 850.0, 500.0])


def test_what_archives_hold_beside_the_file(tmp_path):
    """A Mac's archive would be refused."""
    wyoming_csv(tmp_path / "a")
    with zipfile.ZipFile(tmp_path / "b", "w") as archive:
        archive.write(tmp_path / "a", "a.csv")
        archive.writestr("__MACOSX/._a.csv", b"x")
    assert read_air_file(tmp_path / "b", WANTED).parts
    (tmp_path / "c").write_bytes(b"\x1f\x8b\x08" + bytes(20))
    with pytest.raises(TwilightError, match=r"is compressed \(gzip\); unpack it"):
        read_air_file(tmp_path / "c", WANTED)
