"""Tables of radiances computed elsewhere: what is read, what is refused, where it is looked up."""

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.numerics.spectrum import solar_irradiance
from twilight.studies.compare.comparison import ABSOLUTE, SUN_NORMALISED, read_added, rows_of, scene_of
from twilight.studies.compare.reference_solution import ReferenceSolution

HEAD = "sun_elevation_deg,elevation_deg,azimuth_deg,wavelength_nm,"
SCENE = {"version": 1, "climate": {"version": 1, "name": "air"}}


def table(tmp_path, text, column=SUN_NORMALISED):
    (tmp_path / "mine.csv").write_text(f"# made by hand\n{HEAD}{column}\n\n{text}")
    return str(tmp_path / "mine.csv")


def reference(radiance, nm=(450.0, 550.0)):
    shape = np.array(radiance)
    return ReferenceSolution(np.array([10.0, 80.0]), np.array([30.0, 200.0]), np.array(nm), shape, 0.0 * shape)


ROWS = "5,10,330,450,.02\n5,10,330,550,.03\n5,80,-160,450,.04\n5,80,-160,550,.05\n"
RIGHT = np.array([[0.02, 0.03], [0.04, 0.05]]) / 1.1


def test_radiances_are_found_on_either_side_of_the_sun_and_have_their_errors(tmp_path):
    """Mirror directions would not be found."""
    made = read_added(f"my code={table(tmp_path, ROWS)}")
    assert (made.name, made.suns(), made.wavelength_nm()) == ("my code", [5.0], [450.0, 550.0])
    config = scene_of(load(SCENE), made)
    assert config.wavelengths.wavelength_nm == (450.0, 550.0)
    (row,) = rows_of(made, {5.0: reference(RIGHT)}, config)
    assert row.preset.name == "my code added" and row.timing is None
    assert row.error.median == pytest.approx(10.0) and row.error.largest == pytest.approx(10.0)
    with pytest.raises(TwilightError, match=r"mine\.csv: has no radiance for sun 5, elevation 80, azimuth 201 deg and"):
        rows_of(made, {5.0: ReferenceSolution(*[np.array([80.0]), np.array([201.0]), np.array([450.0])], RIGHT, RIGHT)},
                config)  # fmt: skip


def test_absolute_radiances_are_divided_by_the_sun_that_sky_h5_holds(tmp_path):
    """Absolute radiances would be compared in another unit."""
    at = load({**SCENE, "sun": {"elevation_deg": 5, "distance_au": 1.01}})
    irradiance = solar_irradiance(np.array([450.0, 550.0]), at.solar_spectrum, 1.01)
    text = "".join(
        f"5,{e},{a},{nm},{RIGHT[i, w] * irradiance[w]!r}\n".replace("np.float64(", "").replace(")", "")
        for i, (e, a) in enumerate(((10, 30), (80, 200)))
        for w, nm in enumerate((450, 550))
    )
    (row,) = rows_of(read_added(table(tmp_path, text, ABSOLUTE)), {5.0: reference(RIGHT)}, at)
    assert row.preset.solver == "mine" and row.error.largest < 1e-9


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"{HEAD}radiance_per_sr\n", "mine.csv: holds no radiances"),
        ("", "mine.csv: holds no radiances"),
        ("sun_elevation_deg,elevation_deg\n", "line 1: lacks the column azimuth_deg"),
        (f"#\n\n{HEAD}radiance\n5,1,1,1,1\n", "line 3: needs one column of radiances, radiance_per_sr"),
        (f"{HEAD}{SUN_NORMALISED},{ABSOLUTE}\n", "radiance_w_per_m2_sr_nm, and has both"),
        (f"{HEAD}{SUN_NORMALISED}\n5,10,0,550,x\n", "line 2: radiance_per_sr is 'x'; it must be a number, 0 or more"),
        (f"{HEAD}{SUN_NORMALISED}\n5,10,0,550,-1\n", "line 2: radiance_per_sr is '-1'"),
        (f"{HEAD}{SUN_NORMALISED}\n5,95,0,550,1\n", "line 2: elevation_deg is '95'; it must be a number, from -90"),
        (f"{HEAD}{SUN_NORMALISED}\n5,10,nan,550,1\n", "line 2: azimuth_deg is 'nan'"),
        (f"{HEAD}{SUN_NORMALISED}\n5,10,0,550\n", "line 2: has 4 cells, the header has 5"),
        (f"{HEAD}{SUN_NORMALISED}\n5,10,0,550,1\n5,10,360,550,2\n", "line 3: has the sun, direction and wavel"),
    ],
)  # fmt: skip
def test_a_bad_table_is_one_sentence_with_file_line_and_column(tmp_path, text, says):
    """A slip in a table would be a wrong error."""
    (tmp_path / "mine.csv").write_text(text)
    with pytest.raises(TwilightError) as found:
        read_added(str(tmp_path / "mine.csv"))
    assert says in str(found.value) and "mine.csv" in str(found.value) and "\n" not in str(found.value)


def test_gaps_are_named_before_anything_is_computed(tmp_path):
    """A gap would be found after hours."""
    made = read_added(table(tmp_path, "5,10,30,450,.1\n5,10,30,550,.1\n5,80,20,450,.1\n"))
    with pytest.raises(TwilightError, match="no radiance for sun 5, elevation 80, azimuth 20 deg and 550 nm"):
        scene_of(load(SCENE), made)
    with pytest.raises(TwilightError, match="cannot read the table"):
        read_added(str(tmp_path / "none.csv"))
