"""Cameras: the geometric model of a picture, and how pictures are read."""

from twilight.studies.camera.document import read_camera, write_camera
from twilight.studies.camera.model import CameraModel, ImageSize, Lens, Orientation

__all__ = ["CameraModel", "ImageSize", "Lens", "Orientation", "read_camera", "write_camera"]
