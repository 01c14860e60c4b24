"""Labels, units and other CF attributes of the variables of datasets (`sky.h5`, series, sweeps)."""

from typing import NamedTuple

from twilight.base.conventions import STOKES_REFERENCE


class Label(NamedTuple):
    """text: a few words; unit: as UDUNITS spells it; comment: what else is to be known; standard_name: of CF."""

    text: str
    unit: str
    comment: str = ""
    standard_name: str = ""


LABELS = {
    "wavelength": Label("wavelength", "nm", "in vacuum", "radiation_wavelength"),
    "elevation": Label("elevation", "degree", "of the line of sight above the geometric horizon"),
    "azimuth": Label(
        "azimuth from the sun",
        "degree",
        "of the line of sight, clockwise seen from above; a circle: .sky.interp goes on beyond its last value",
    ),
    **dict.fromkeys(
        ("solar_elevation_angle", "sun_elevation_deg"),
        Label("sun elevation", "degree", "true (unrefracted), of the disc's centre", "solar_elevation_angle"),
    ),
    "apparent_solar_elevation_angle": Label("apparent sun elevation", "degree", "refracted, of the disc's centre"),
    "solar_azimuth_angle": Label("sun azimuth", "degree", "clockwise from north", "solar_azimuth_angle"),
    "solar_bending": Label("refraction of the sun", "degree", "apparent minus true elevation"),
    "earth_sun_distance": Label("distance of the sun", "astronomical_unit"),
    "observer_altitude": Label("observer altitude", "km", "above sea level", "altitude"),
    "latitude": Label("latitude", "degrees_north", "", "latitude"),
    "longitude": Label("longitude", "degrees_east", "", "longitude"),
    "time": Label("time (UTC)", "seconds since 1970-01-01 00:00:00", "", "time"),
    "scene": Label("scene", ""),
    "draw": Label("draw", ""),
    "turbidity": Label("turbidity", "1", "optical depth of air and aerosol over that of air, at 550 nm"),
    "radiance": Label(
        "radiance",
        "W m-2 nm-1 sr-1",
        "spectral, of the sky without the sun's disc: sun_normalised_radiance times solar_irradiance, plus "
        "night_radiance where there is one",
        "downwelling_radiance_per_unit_wavelength_in_air",
    ),
    "sun_normalised_radiance": Label(
        "radiance / solar irradiance", "sr-1", "spectral; the irradiance is that on top of the atmosphere"
    ),
    "standard_error": Label("standard error", "sr-1", "of sun_normalised_radiance"),
    "night_radiance": Label(
        "radiance of the night",
        "W m-2 nm-1 sr-1",
        "spectral, of airglow, starlight and zodiacal light at the observer, mean over wavelength_bnds",
    ),
    "luminance": Label("luminance", "cd m-2", "V(lambda) of the CIE 1931 observer, integrated at 1 nm"),
    "solar_irradiance": Label(
        "solar irradiance",
        "W m-2 nm-1",
        "on top of the atmosphere, mean over each wavelength's bin",
        "solar_irradiance_per_unit_wavelength",
    ),
    "surface_albedo": Label("albedo of the ground", "1", "Lambertian", "surface_albedo"),
    "direct_irradiance_factor": Label(
        "sunbeam / solar irradiance",
        "1",
        "irradiance of the sun's beam at the observer, normal to it, over that on top of the atmosphere",
    ),
    "sun_normalised_radiance_q": Label("Stokes Q / solar irradiance", "sr-1", STOKES_REFERENCE),
    "sun_normalised_radiance_u": Label("Stokes U / solar irradiance", "sr-1", STOKES_REFERENCE),
    "standard_error_q": Label("standard error of Q", "sr-1", "of sun_normalised_radiance_q"),
    "standard_error_u": Label("standard error of U", "sr-1", "of sun_normalised_radiance_u"),
    "degree_of_linear_polarisation": Label("degree of linear polarisation", "1", "of all light: sqrt(Q^2 + U^2) / I"),
    "angle_of_linear_polarisation": Label(
        "angle of linear polarisation",
        "degree",
        f"of vibration from the vertical, clockwise seen along the line of sight: atan2(U, Q) / 2; {STOKES_REFERENCE}",
    ),
    "disc_elevation": Label("apparent elevation", "degree", "of a line of sight to the sun's disc"),
    "disc_true_elevation": Label("true elevation", "degree", "that the line of sight to the sun's disc comes from"),
    "disc_transmittance": Label(
        "transmittance to the disc",
        "1",
        "of the line of sight, times the square of the observer's refractive index; 0: it meets the ground or is "
        "caught in a duct",
    ),
    "disc_radius": Label("radius of the disc", "degree", "above the air"),
}


def attributes(name: str) -> dict[str, str]:
    """CF attributes of a variable: standard_name, long_name, units and comment, those that it has."""
    label = LABELS[name]
    cf = {
        "standard_name": label.standard_name,
        "long_name": label.text,
        "units": label.unit,
        "comment": label.comment,
    }
    return {key: value for key, value in cf.items() if value}
