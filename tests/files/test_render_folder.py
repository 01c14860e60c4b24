"""The folder of a render: nothing is lost, nothing stale stays, what is finished is not computed again."""

import numpy as np
import pytest
from toy_sky import glow_sky

from twilight.base.errors import TwilightError
from twilight.io.folder import JOURNAL, RequestedSky, open_folder
from twilight.io.netcdf import write_sky

A = RequestedSky("a", {"climate": {"ground": {"albedo": 0.2}}, "list": [1, 2]})
B = RequestedSky("b", {"climate": {"ground": {"albedo": 0.5}}, "list": [1, 2]})


def render(root, wanted, code="1", overwrite=False, stop_after=None):
    """Names of the skies that were made."""
    made = []
    with open_folder(root, wanted, code, overwrite=overwrite) as folder:
        for name, one in wanted.items():
            if name in folder.finished:
                assert folder.finished[name] == {"name": name}
                continue
            if len(made) == stop_after:
                raise KeyboardInterrupt
            (root / name).mkdir(parents=True, exist_ok=True)
            sky = glow_sky(step_deg=30.0, provenance={"configuration": one.configuration})
            files = [write_sky(sky, root / name / "sky.h5"), root / name / "sky.png"]
            files[1].write_bytes(b"png of " + one.hash.encode())
            folder.add(name, one, files, {"name": name})
            made.append(name)
        if len(wanted) > 1:
            folder.begin_series_files()
    return made


def content(root):
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()} - {JOURNAL}


def test_what_is_finished_is_not_made_again(tmp_path):
    """A finished sky would be made again, or a damaged one kept."""
    root, series = tmp_path / "out", {f"sun{i}": RequestedSky(f"{i}", {"sun": i}) for i in range(5)}
    with pytest.raises(KeyboardInterrupt):
        render(root, series, stop_after=2)
    (root / "sun1" / "sky.png").write_bytes(b"")  # damaged meanwhile
    with open(root / JOURNAL, "a") as journal:
        journal.write('{"sky": "sun2", "ha')
    assert render(root, series) == ["sun1", "sun2", "sun3", "sun4"]
    assert render(root, series) == []
    assert render(root, series | {"sun5": RequestedSky("5", {})}) == ["sun5"]  # a longer series keeps what is there
    assert render(root, series | {"sun5": RequestedSky("5", {})}, code="2") == [*series, "sun5"]  # of another program
    assert render(root, series | {"sun5": RequestedSky("5", {})}, code="2", overwrite=True) == [*series, "sun5"]


def test_another_sky_is_refused_and_says_which_key_differs(tmp_path):
    """A sky would be overwritten by another."""
    render(tmp_path, {"": A})
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(
        TwilightError, match=r"holds another sky \(ground.albedo is 0.2, asked is 0.5\); give --overwrite"
    ):
        render(tmp_path, {"": B})
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == before
    assert render(tmp_path, {"": B}, overwrite=True) == [""]
    assert (tmp_path / "sky.png").read_bytes() == b"png of b"


def test_frames_that_would_be_stale_are_refused_or_deleted(tmp_path):
    """Frames of an older render would stay among the new ones."""
    render(tmp_path, {"x/sun1": A, "x/sun2": B})
    (tmp_path / "contact-sheet.png").write_bytes(b"sheet")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(
        TwilightError, match=r"x/sun1: holds a sky that is not part of this render; --overwrite deletes"
    ):
        render(tmp_path, {"x/sun2": B})
    render(tmp_path, {"x/sun2": B}, overwrite=True)
    assert content(tmp_path) == {"x/sun2/sky.h5", "x/sun2/sky.png", "notes.txt"}
    assert not (tmp_path / "x/sun1").exists()


def test_files_that_no_journal_knows_are_not_overwritten(tmp_path):
    """A user's file would be overwritten."""
    (tmp_path / "sky.png").write_bytes(b"a picture of mine")
    with pytest.raises(TwilightError, match=r"sky.png: is there already, and skies.jsonl does not say of which sky"):
        render(tmp_path, {"": A})
    assert content(tmp_path) == {"sky.png"} and not (tmp_path / JOURNAL).exists()
    (tmp_path / JOURNAL).write_text(
        '{"sky": "../..", "hash": "", "code": "", "files": {"../../x": 1}, "figures": {}}\n'
    )
    (tmp_path / "sky.png").unlink()
    assert render(tmp_path, {"": A}) == [""]


def test_two_renders_do_not_write_one_folder(tmp_path):
    """Two renders would mix their files."""
    with open_folder(tmp_path, {"": A}, "1", overwrite=False):
        with pytest.raises(TwilightError, match="another render is writing it"):
            render(tmp_path, {"": A})


def test_a_sky_that_was_moved_away_is_no_obstacle(tmp_path):
    """A folder would be blocked by a sky that is gone."""
    render(tmp_path, {"": A})
    (tmp_path / "kept").mkdir()
    for file in tmp_path.glob("sky.*"):
        file.rename(tmp_path / "kept" / file.name)
    assert render(tmp_path, {"": B}) == [""]
    assert np.array_equal(sorted(content(tmp_path)), ["kept/sky.h5", "kept/sky.png", "sky.h5", "sky.png"])


def test_a_sky_whose_files_were_begun_is_made_again(tmp_path):
    """Files of a killed render would be taken for somebody's."""
    root = tmp_path / "out"
    with open_folder(root, {"sun1": A}, "1", overwrite=False) as folder:
        folder.begin("sun1", A)
        (root / "sun1").mkdir()
        (root / "sun1" / "sky.png").write_bytes(b"whole")
        (root / "sun1" / ".sky.h5.0123abcd.part.h5").write_bytes(b"half")
    with pytest.raises(TwilightError, match="holds another sky"):
        render(root, {"sun1": B})
    with open_folder(root, {"sun1": A}, "1", overwrite=False) as folder:
        folder.begin("sun1", A)
        assert content(root) == {"sun1/sky.png"}
    assert render(root, {"sun1": A}) == ["sun1"]
    assert render(root, {"sun1": A}) == []


def test_a_sky_that_was_begun_and_not_written_leaves_no_folder(tmp_path):
    """An empty folder would be left."""
    root = tmp_path / "out"
    with open_folder(root, {"": A}, "1", overwrite=False) as folder:
        folder.begin("", A)
    assert not root.exists()


def test_what_a_killed_render_has_not_written_is_not_deleted(tmp_path):
    """--overwrite would delete files of the user."""
    (tmp_path / "sun.json").write_text("a sun of mine")
    (tmp_path / "sky.blend").write_text("a scene of mine")
    with open_folder(tmp_path, {"": A}, "1", overwrite=True) as folder:
        folder.begin("", A)
        (tmp_path / "sky.rgb.exr").write_bytes(b"whole")
        (tmp_path / ".sky.h5.0123abcd.part.h5").write_bytes(b"half")
    (tmp_path / "sky.txt").write_text("a note of mine")
    with open_folder(tmp_path, {"": B}, "1", overwrite=True) as folder:
        assert content(tmp_path) == {"sun.json", "sky.blend", "sky.txt"}
        folder.begin("", B)
        (tmp_path / "sky.rgb.exr").write_bytes(b"whole")
    with open_folder(tmp_path, {"": B}, "1", overwrite=False) as folder:
        folder.begin("", B)  # what the render before had begun stays its own
    with open_folder(tmp_path, {"": B}, "1", overwrite=True) as folder:
        assert content(tmp_path) == {"sun.json", "sky.blend", "sky.txt"}
        folder.add("", B, [tmp_path / "sun.json"], {})
        assert folder.file_names() == {"": ["sun.json"]}
        (tmp_path / JOURNAL).write_text("")
    assert (tmp_path / "sun.json").read_text() == "a sun of mine"


def test_what_a_series_has_once_is_a_renders_only_where_the_journal_says_so(tmp_path):
    """A user's table would be overwritten or deleted."""
    series = {"sun1": A, "sun2": B}
    mine = {"series.csv": "a table of mine", "frames/sky.0001.png": "a frame of mine", "frames/sky.blend": "a scene"}
    for name, text in mine.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    render(tmp_path, {"": A})  # one sky writes none of these, with or without --overwrite
    render(tmp_path, {"": A}, overwrite=True)
    assert all((tmp_path / name).read_text() == text for name, text in mine.items())
    with pytest.raises(TwilightError, match="holds a sky that is not part"):
        render(tmp_path, series)
    other = tmp_path / "other"
    other.mkdir()
    (other / "series.csv").write_text("a table of mine")
    with pytest.raises(TwilightError, match=r"series.csv: is there already, and skies.jsonl does not say"):
        render(other, series)
    assert content(other) == {"series.csv"}
    with open_folder(other, series, "1", overwrite=True) as folder:
        folder.begin_series_files()
        (other / "series.csv").write_text("of the render")
        (other / "frames").mkdir()
        (other / "frames" / "sky.0001.png").write_text("of the render")
        (other / "frames" / "notes.txt").write_text("of mine")
        (other / "sky.png").write_text("of the render")
        folder.add("", A, [other / "sky.png"], {})
    with open_folder(other, series, "1", overwrite=True):
        assert content(other) == {"frames/notes.txt"}


def test_a_finished_sky_that_is_begun_again_is_not_taken_for_somebodys(tmp_path):
    """A render that was killed would block its folder."""
    render(tmp_path, {"": A})
    with open_folder(tmp_path, {"": A}, "2", overwrite=False) as folder:
        folder.begin("", A)  # by a newer program, and killed
    assert render(tmp_path, {"": B}, overwrite=True) == [""]
    assert content(tmp_path) == {"sky.h5", "sky.png"}
