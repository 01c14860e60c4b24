"""Cameras: the geometric model of a picture, and how pictures are read."""

from twilight.camera.document import read_camera, write_camera
from twilight.camera.model import Camera, ImageSize, Lens, Orientation
from twilight.orientation import azimuth_elevation, camera_axes, direction, orientation_angles

__all__ = [
    "Camera",
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
