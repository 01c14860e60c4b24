"""Files: what a sky is written to and read from, each whole or not at all, each saying where it comes from."""

from twilight.base.whole_files import whole_file
from twilight.io.environment_files import write_hdr
from twilight.io.exr import LatLong, read_latlong_exr, read_spectral_exr, write_rgb_exr, write_spectral_exr
from twilight.io.folder import write_outputs
from twilight.io.netcdf import read_sky, sky_to_dataset, write_sky
from twilight.io.picture import render_view, write_png, write_polarisation_png

__all__ = [
    "LatLong",
    "read_latlong_exr",
    "read_sky",
    "read_spectral_exr",
    "render_view",
    "sky_to_dataset",
    "whole_file",
    "write_hdr",
    "write_outputs",
    "write_png",
    "write_polarisation_png",
    "write_rgb_exr",
    "write_sky",
    "write_spectral_exr",
]
