"""`camera.yaml`: read, and written whole or not at all."""

from __future__ import annotations

from os.path import isfile
from pathlib import Path

import yaml

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.config.document import read_yaml
from twilight.config.validate import Origins, validate
from twilight.studies.camera.model import CameraModel

KNOWN_RESPONSES = ("linear", "srgb")

HEAD = """\
# A camera for `twilight validate`.  Pixel positions count from the picture's upper left corner, azimuths clockwise from
# north; off the axis by the angle t, the radius in pixels is focal_length_px * v with v = u (1 + k1 u^2 + ...) and
# u = t (equidistant), 2 sin(t/2) (equisolid), 2 tan(t/2) (stereographic), sin t (orthographic), tan t (perspective).
"""


def read_camera(path: str | Path) -> CameraModel:
    """The camera in a YAML file; a response curve's path counts from the folder of that file.

    Errors: TwilightError that names the file, the key and what is allowed, also where the response curve is missing.
    """
    path = Path(path)
    data = read_yaml(path)
    camera = validate(CameraModel, data, Origins({(): str(path)}))
    response = camera.response
    if isinstance(response, str) and response not in KNOWN_RESPONSES:
        curve = path.parent / response
        if not isfile(curve):
            raise TwilightError(
                f"{path}: response must be linear, srgb, an exponent or the path of a CSV file; there is no {curve}"
            )
        camera = camera.model_copy(update={"response": str(curve)})
    return camera


def write_camera(path: str | Path, camera: CameraModel) -> None:
    """Write a camera as YAML that `read_camera` reads, whole or not at all; keys without a value are left out.

    The path of a response curve is written as an absolute one, because the file may go to another folder.
    Raises TwilightError where it cannot be written.
    """
    data = camera.model_dump(mode="json", exclude_none=True)
    data["lens"] = {k: v for k, v in data["lens"].items() if v not in ([], False)}
    if camera.orientation.azimuth_deg is None:
        data["orientation"] = {"azimuth_deg": None, **data["orientation"]}
    if isinstance(camera.response, str) and camera.response not in KNOWN_RESPONSES:
        data["response"] = str(Path(camera.response).absolute())
    if not data["lens"]:
        del data["lens"]
    text = HEAD + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
