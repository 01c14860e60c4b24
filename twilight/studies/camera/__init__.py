"""Cameras: the geometric model of a picture, and how pictures are read."""

from twilight.studies.camera.model import CameraModel, ImageSize, Lens, Orientation, read_camera, write_camera

__all__ = ["CameraModel", "ImageSize", "Lens", "Orientation", "read_camera", "write_camera"]
