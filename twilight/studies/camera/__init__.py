"""Cameras: the geometric model of a picture, and how pictures are read."""

from twilight.numerics.orientation import azimuth_elevation, camera_axes, direction, orientation_angles
from twilight.studies.camera.document import read_camera, write_camera
from twilight.studies.camera.model import CameraModel, ImageSize, Lens, Orientation

__all__ = [
    "CameraModel",
    "ImageSize",
    "Lens",
    "Orientation",
    "azimuth_elevation",
    "camera_axes",
    "direction",
    "orientation_angles",
    "read_camera",
    "write_camera",
]
