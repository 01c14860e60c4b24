"""Files of measurements as their makers write them, with an atmosphere of the tests' choice inside."""

import numpy as np

from twilight.atmosphere import measured
from twilight.atmosphere.profiles import load_profile

LATITUDE = 48.25
"""Of the station that soundings rise from [deg]: Oberschleissheim."""
LONGITUDE = 11.55
"""East, of the same [deg]."""
PRESSURES_HPA = (1000, 975, 950, 925, 900, 875, 850, 825, 800, 775, 750, 700, 650, 600, 550, 500, 450, 400, 350, 300,
                 250, 225, 200, 175, 150, 125, 100, 70, 50, 30, 20, 10, 7, 5, 3, 2, 1)  # fmt: skip
"""Pressure levels of ERA5."""


def dew_point_c(e_hpa):
    """The inverse of Magnus' formula."""
    y = np.log(e_hpa / 6.112)
    return 243.12 * y / (17.62 - y)


def rows_of(name="midlatitude_summer"):
    """Altitude [km], p [hPa], T [K], e / p and ozone's mixing ratio of an AFGL atmosphere at its altitudes to 31 km."""
    a = load_profile(name)
    k = a.altitude_km <= 31.0
    air = a.air_per_cm3[k]
    return a.altitude_km[k], a.pressure_hpa[k], a.temperature_k[k], a.h2o_per_cm3[k] / air, a.o3_per_cm3[k] / air


def wyoming(path, name="midlatitude_summer"):
    """TEXT:LIST of the University of Wyoming."""
    z, p, t, x, _ = rows_of(name)
    height = 1e3 * measured.geopotential_km(z, LATITUDE)
    rule = "-" * 77
    lines = [
        "<HTML>", "<TITLE>University of Wyoming - Radiosonde Data</TITLE>",
        "<H2>10868 Muenchen-Oberschleissheim Observations at 12Z 21 Jun 2026</H2>", "<PRE>", rule,
        "   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV",
        "    hPa     m      C      C      %    g/kg    deg   knot     K      K      K ", rule,
    ]  # fmt: skip
    for i in range(z.size):
        dew = dew_point_c(x[i] * p[i])
        relh = 100.0 * x[i] * p[i] / measured.saturation_pressure_hpa(t[i])
        mixr = 622.0 * x[i] / (1.0 - x[i])
        row = f"{p[i]:7.1f}{height[i]:7.0f}{t[i] - 273.15:7.1f}{dew:7.1f}{relh:7.0f}{mixr:7.2f}"
        lines.append(f"{row}    350      8  293.3  313.2  294.5")
    lines += [
        "</PRE><H3>Station information and sounding indices</H3><PRE>",
        "                         Station identifier: ", "                             Station number: 10868",
        "                           Observation time: 260621/1200",
        f"                           Station latitude: {LATITUDE}",
        f"                          Station longitude: {LONGITUDE}",
        "                          Station elevation: 0.0", "</PRE>", "</HTML>",
    ]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def igra(path):
    """IGRA version 2: a sounding a day, that of the 21st with the atmosphere, the others 5 K warmer."""
    z, p, t, x, _ = rows_of()
    height = 1e3 * measured.geopotential_km(z, LATITUDE)
    lines = []
    for day in (20, 21, 22):
        warmer = 0.0 if day == 21 else 5.0
        place = f"{round(1e4 * LATITUDE):7d} {round(1e4 * LONGITUDE):8d}"
        lines.append(f"#GMM00010868 2026 06 {day:02d} 12 1045 {z.size + 1:4d} ncdc-gts ncdc-gts {place}")
        for i in range(z.size):
            gph = round(height[i]) if i % 3 == 0 else -9999  # heights at standard levels alone
            depression = round(10 * (t[i] - 273.15 - dew_point_c(x[i] * p[i]))) if i % 2 else -9999
            rh = round(1000.0 * x[i] * p[i] / measured.saturation_pressure_hpa(t[i])) if not i % 2 else -8888
            kelvin = round(10 * (t[i] + warmer - 273.15))
            lines.append(
                f"{'21' if i == 0 else '20'} -9999 {round(100 * p[i]):6d} {gph:5d}B{kelvin:5d}B{rh:5d} {depression:5d}"
                "   260    35"
            )
        lines.append("30 -9999  -9999  1500 -9999 -9999 -9999   270    40")  # wind alone, at a height
    path.write_text("\n".join(lines) + "\n")
    return path


def on_pressures(name, pressures):
    """Geopotential [m2 s-2], T [K], specific humidity and ozone's mass mixing ratio at pressures."""
    a = load_profile(name)
    fine = np.linspace(0.0, 119.0, 120000)
    there = a.at(fine)
    z = np.interp(-np.log(pressures), -np.log(there.pressure_hpa), fine)
    at = a.at(z)
    x, o = at.h2o_per_cm3 / at.air_per_cm3, at.o3_per_cm3 / at.air_per_cm3
    q = measured.EPSILON * x / (1.0 - (1.0 - measured.EPSILON) * x)
    molar = measured.MOLAR_MASS_DRY * (1.0 - (1.0 - measured.EPSILON) * x)
    geopotential = 1e3 * measured.geopotential_km(z, LATITUDE) * measured.STANDARD_GRAVITY
    return geopotential, at.temperature_k, q, o * measured.MOLAR_MASS_OZONE / molar


def _maps(name, slope_k=0.0):
    """ERA5's fields over 2 times, the pressures, 3 latitudes (north first) and 3 longitudes."""
    p = np.array([p for p in PRESSURES_HPA if p <= load_profile(name).pressure_hpa[0]], dtype=float)
    z, t, q, o3 = on_pressures(name, p)
    ones = np.ones((2, p.size, 3, 3))
    hours = np.arange(2).reshape(2, 1, 1, 1)
    return p, {
        "z": z[None, :, None, None] * ones, "t": t[None, :, None, None] * ones + slope_k * (hours - 0.5),
        "q": q[None, :, None, None] * ones, "o3": o3[None, :, None, None] * ones,
    }  # fmt: skip


LATITUDES = [48.5, 48.25, 48.0]
"""Of the grids of reanalyses, from north to south [deg]."""
LONGITUDES = [11.25, 11.5, 11.75]
"""East, of the same [deg]."""
TIMES = np.array(["2026-06-21T18:00", "2026-06-21T19:00"], dtype="datetime64[ns]")


def era5(path, name="midlatitude_summer", slope_k=0.0, clouds=False, **drop):
    """ERA5 on pressure levels as the Copernicus data store gives it since 2024: netCDF-4, valid_time."""
    import xarray

    p, fields = _maps(name, slope_k)
    dims = ("valid_time", "pressure_level", "latitude", "longitude")
    if clouds:  # a deck between 850 and 750 hPa, a veil from 300 to 250 hPa, and what covers little at 500 hPa
        at = p[None, :, None, None] * np.ones_like(fields["t"])
        low, high, some = (at >= 750) & (at <= 850), (at >= 250) & (at <= 300), at == 500
        fields["cc"] = 1.0 * low + 0.8 * high + 0.2 * some
        fields["clwc"], fields["ciwc"] = 1e-4 * low + 1e-4 * some, 2e-5 * high
    units = {"z": "m**2 s**-2", "t": "K", "q": "kg kg**-1", "o3": "kg kg**-1", "cc": "(0 - 1)"}
    units |= dict.fromkeys(("clwc", "ciwc"), "kg kg**-1")
    data = xarray.Dataset(
        {key: (dims, value, {"units": units[key]}) for key, value in fields.items() if key not in drop},
        {
            "valid_time": TIMES, "pressure_level": ("pressure_level", p, {"units": "hPa"}), "latitude": LATITUDES,
            "longitude": LONGITUDES, "number": 0, "expver": ("valid_time", ["0001", "0001"]),
        },
        {"Conventions": "CF-1.7", "institution": "European Centre for Medium-Range Weather Forecasts"},
    )  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf")
    return path


def merra2(path):
    """MERRA-2 inst3_3d_asm_Np with columns of tavg1_2d_aer_Nx; under the ground values are missing."""
    import xarray

    p, fields = _maps("midlatitude_summer")
    dims = ("time", "lev", "lat", "lon")
    upside = {key: value[:, :, ::-1] for key, value in fields.items()}
    upside["z"][:, 0] = np.nan
    flat = np.ones((2, 3, 3))
    data = xarray.Dataset(
        {
            "T": (dims, upside["t"]), "QV": (dims, upside["q"]), "O3": (dims, upside["o3"]),
            "H": (dims, upside["z"] / measured.STANDARD_GRAVITY), "QL": (dims, 0.0 * upside["q"]),
            "TOTEXTTAU": (dims[:1] + dims[2:], 0.21 * flat), "TOTANGSTR": (dims[:1] + dims[2:], 1.4 * flat),
            "TO3": (dims[:1] + dims[2:], 331.0 * flat), "TQV": (dims[:1] + dims[2:], 25.0 * flat),
        },
        {"time": TIMES, "lev": ("lev", p, {"units": "hPa"}), "lat": LATITUDES[::-1], "lon": LONGITUDES},
        {"Title": "MERRA-2 inst3_3d_asm_Np"},
    )  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf")
    return path


def cams(path):
    """CAMS EAC4, single levels, netCDF-3 of a single time."""
    import xarray

    dims = ("time", "latitude", "longitude")
    depth = {"aod469": 0.30, "aod550": 0.25, "aod670": 0.19, "aod865": 0.13, "aod1240": 0.08}
    values = {key: (dims, np.full((1, 3, 3), value)) for key, value in depth.items()}
    values["gtco3"] = (dims, np.full((1, 3, 3), 320.0 * 2.1415e-5))
    data = xarray.Dataset(values, {"time": TIMES[:1], "latitude": LATITUDES, "longitude": LONGITUDES})
    data.to_netcdf(path, engine="scipy")
    return path


def grib(path):
    """ERA5 in GRIB 1, a message a field and level; ozone at fewer levels."""
    import eccodes

    p, fields = _maps("midlatitude_summer")
    codes = {"z": 129, "t": 130, "q": 133, "o3": 203}
    with open(path, "wb") as file:
        for key, param in codes.items():
            for k, pressure in enumerate(p):
                if key == "o3" and pressure > 900.0:  # as some requests have it
                    continue
                message = eccodes.codes_grib_new_from_samples("regular_ll_pl_grib1")
                for entry, value in {
                    "table2Version": 128, "centre": 98, "dataDate": 20260621, "dataTime": 1800, "Ni": 3, "Nj": 3,
                    "latitudeOfFirstGridPointInDegrees": LATITUDES[0],
                    "latitudeOfLastGridPointInDegrees": LATITUDES[-1],
                    "longitudeOfFirstGridPointInDegrees": LONGITUDES[0],
                    "longitudeOfLastGridPointInDegrees": LONGITUDES[-1],
                    "iDirectionIncrementInDegrees": 0.25, "jDirectionIncrementInDegrees": 0.25,
                    "typeOfLevel": "isobaricInhPa", "level": int(pressure), "paramId": param, "bitsPerValue": 24,
                }.items():  # fmt: skip
                    eccodes.codes_set(message, entry, value)
                eccodes.codes_set_values(message, fields[key][0, k].ravel())
                eccodes.codes_write(message, file)
                eccodes.codes_release(message)
    return path


AERONET_TEXT = (
    "AERONET Version 3;\nMunich_University\nVersion 3: AOD Level 1.5\n"
    "The following data are cloud cleared and quality controls have been applied but these data may not have final "
    "calibration applied.  These data may change.\nContact: PI=A_Person; PI Email=a.person@example.org\n"
    "All Points,UNITS can be found at,,, https://aeronet.gsfc.nasa.gov/new_web/units.html\n"
)
AOD = {1640: 0.060, 1020: 0.090, 870: 0.110, 675: 0.150, 500: 0.230, 440: 0.270, 380: 0.320, 340: 0.350}


def aeronet(path, depths=AOD, exponent=1.3):
    """AOD of version 3, all points: each measurement 0.01 above the one before; channels without a filter are -999."""
    channels = [1640, 1020, 870, 865, 779, 675, 667, 500, 490, 440, 412, 400, 380, 340]
    names = ["Date(dd:mm:yyyy)", "Time(hh:mm:ss)", "Day_of_Year", "Day_of_Year(Fraction)"]
    names += [f"AOD_{nm}nm" for nm in channels] + ["AOD_Empty", "Precipitable_Water(cm)", "440-870_Angstrom_Exponent"]
    names += ["AERONET_Site_Name", "Site_Latitude(Degrees)", "Site_Longitude(Degrees)", "Site_Elevation(m)"]
    names += ["Exact_Wavelengths_of_AOD(um)_500nm", "AERONET_Site"]
    lines = [AERONET_TEXT + ",".join(names)]
    for i, hour in enumerate((6, 12, 18)):
        row = ["21:06:2026", f"{hour:02d}:10:00", "172", f"{172 + hour / 24:.6f}"]
        row += [f"{depths[nm] + 0.01 * i:.6f}" if nm in depths else "-999." for nm in channels]
        row += ["-999.", "2.100000", f"{exponent:.6f}", "Munich_University", "48.148000", "11.573000", "533.000000"]
        lines.append(",".join([*row, "0.5003" if 500 in depths else "-999.", "Munich_University"]))
    path.write_text("\n".join(lines) + "\n")
    return path


RADII_UM = 0.05 * 300.0 ** (np.arange(22) / 21.0)


def log_normal_volume(r, volume, median, sigma):
    return volume / (np.sqrt(2 * np.pi) * sigma) * np.exp(-0.5 * (np.log(r / median) / sigma) ** 2)


def inversion(path):
    """An inversion of version 3 with all products (.all): a fine and a coarse mode."""
    depth, real, imaginary = (0.27, 0.15, 0.11, 0.09), (1.45, 1.45, 1.46, 1.46), (0.008, 0.007, 0.007, 0.007)
    channels = (440, 675, 870, 1020)
    v = log_normal_volume(RADII_UM, 0.05, 0.18, 0.45) + log_normal_volume(RADII_UM, 0.03, 2.6, 0.65)
    names = ["Site", "Date(dd:mm:yyyy)", "Time(hh:mm:ss)", "Day_of_Year", "Day_of_Year(Fraction)"]
    names += [f"AOD_Extinction-Total[{nm}nm]" for nm in channels]
    names += [f"Single_Scattering_Albedo[{nm}nm]" for nm in channels]
    names += [f"Refractive_Index-{part}_Part[{nm}nm]" for part in ("Real", "Imaginary") for nm in channels]
    names += [f"{r:.6f}" for r in RADII_UM] + ["Inflection_Radius_of_Size_Distribution(um)"]
    names += [f"{a}[{nm}nm]" for nm in channels for a in ("180.000000", "0.000000")]
    names += ["Latitude(Degrees)", "Longitude(Degrees)"]
    row = ["Munich_University", "21:06:2026", "16:40:00", "172", "172.694444"]
    row += [f"{value:.6f}" for value in (*depth, *[0.95] * 4, *real, *imaginary, *v)]
    row += ["0.439173", *["1.0"] * 8, "48.148000", "11.573000"]
    text = AERONET_TEXT.replace("AOD Level 1.5", "Almucantar Level 1.5 Inversion")
    path.write_text(text + ",".join(names) + "\n" + ",".join(row) + "\n")
    return path
