"""The notebook of the docs, executed: it shows what its text says, with what `import twilight` offers alone."""

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "examples" / "field.ipynb"


def notebook():
    import nbformat

    return nbformat.read(NOTEBOOK, as_version=4)


def test_it_is_stored_without_outputs_and_takes_what_is_offered_alone():
    """The example would use what is not offered."""
    import twilight

    code = [cell for cell in notebook().cells if cell.cell_type == "code"]
    assert len(code) >= 5 and not any(cell.outputs or cell.execution_count for cell in code)
    text = "\n".join(cell.source for cell in code)
    assert not re.findall(r"twilight\.\w+\.|from twilight", text)
    assert set(re.findall(r"twilight\.(\w+)", text)) <= set(twilight.__all__)


@pytest.mark.slow
def test_it_runs_and_shows_a_picture_for_every_part():
    """The example of the docs would fail."""
    import nbclient
    from PIL import Image

    made = notebook()
    nbclient.NotebookClient(made, timeout=900, kernel_name="python3").execute()
    outputs = [one for cell in made.cells for one in cell.get("outputs", [])]
    assert not [one for one in outputs if one.output_type == "error"]
    pictures = [one.data["image/png"] for one in outputs if "image/png" in one.get("data", {})]
    assert len(pictures) >= 5
    for picture in pictures:
        shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB"), float)
        assert shown.std() > 10.0
    said = "".join(one.text for one in outputs if one.output_type == "stream" and one.name == "stdout")
    assert 40 < int(re.search(r"at most (\d+) % polarised", said)[1]) < 90
