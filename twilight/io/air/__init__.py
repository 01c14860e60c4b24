"""Files of measurements and analyses of the air: each is recognised by its content."""

from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import is_zipfile

from twilight.atmosphere.measured import Reading
from twilight.base.errors import TwilightError
from twilight.io.air import aeronet, gridded, sounding
from twilight.io.air.lines import GZIP, PlaceAndTime, read_bytes, read_lines

__all__ = ["KINDS", "PlaceAndTime", "read_air_file"]

KINDS = {
    "sounding": "a sounding (University of Wyoming's list or CSV, IGRA version 2)",
    "reanalysis": "a reanalysis (ERA5, CAMS, MERRA-2; netCDF or GRIB)",
    "aeronet": "AERONET version 3 (optical depths, or an inversion with all products)",
}
"""Kinds of files, as a configuration names them, and what each can be."""

HDF5 = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file, which NetCDF-4 is too."""
GRIB = b"GRIB"
"""First bytes of a GRIB file."""
HDF4 = b"\x0e\x03\x13\x01"
"""First bytes of an HDF4 file."""
NETCDF3 = (b"CDF\x01", b"CDF\x02", b"CDF\x05")
"""First bytes of a NetCDF-3 file: classic, 64-bit offset, 64-bit data."""


def read_air_file(path: Path, wanted: PlaceAndTime) -> Reading:
    """What a file holds of the air at a place and time.

    Errors: TwilightError that names the file, the line where there is one, and what is allowed.
    """
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder; allowed is a file of measurements")
    head = read_bytes(path, 8)
    if head.startswith((GRIB, *NETCDF3, HDF5)) and is_zipfile(path):
        with TemporaryDirectory(prefix="twilight-") as folder:
            unpacked = Path(folder) / path.name
            unpacked.write_bytes(read_bytes(path))
            try:
                return read_air_file(unpacked, wanted)
            except TwilightError as error:
                raise TwilightError(str(error).replace(str(unpacked), str(path))) from None
    if head.startswith(HDF4):
        raise TwilightError(f"{path}: is HDF4, which is not read; newer versions of the same data come in HDF5")
    if head.startswith(GRIB):
        return gridded.read_gridded(path, "grib", wanted)
    if head.startswith(NETCDF3):
        return gridded.read_gridded(path, "netcdf3", wanted)
    if head.startswith(HDF5):
        return gridded.read_gridded(path, "netcdf", wanted)
    if head.startswith(GZIP):
        raise TwilightError(f"{path}: is compressed (gzip); unpack it")
    lines = read_lines(path)
    if aeronet.is_aeronet(lines):
        return aeronet.read_aeronet(path, wanted)
    if sounding.is_igra(lines) or sounding.is_wyoming(lines) or sounding.is_wyoming_csv(lines):
        return sounding.read_sounding(path, wanted)
    raise TwilightError(f"{path}: is none of the files that are read: {'; '.join(KINDS.values())}")
