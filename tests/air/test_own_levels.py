"""atmosphere.levels from a CSV file: the same air as its columns written out, and recorded as such."""

import pytest

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.climate import air_profile

COLUMNS = ("altitude_km", "pressure_hpa", "temperature_k", "water_vapour_ppm", "ozone_ppm")
ROWS = [(0.0, 1013.0, 290.0, 9000.0, 0.03), (10.0, 265.0, 223.0, 80.0, 0.1), (100.0, 3e-4, 195.0, 1.0, 0.5)]


def write(path, rows=ROWS, mark=","):
    path.write_text("\n".join([mark.join(COLUMNS), *(mark.join(map(str, row)) for row in rows)]) + "\n")


def scene(folder, levels):
    (folder / "mine.yaml").write_text(f"version: 1\nname: mine\natmosphere: {{levels: {levels}}}\n")
    return load(folder / "mine.yaml")


def test_levels_of_a_file_are_those_written_out(tmp_path):
    write(tmp_path / "my.csv")
    found = scene(tmp_path, "{file: my.csv}").climate
    written = {name: list(column) for name, column in zip(COLUMNS, zip(*ROWS, strict=True), strict=True)}
    expected = load(
        {"version": 1, "climate": {"version": 1, "name": "mine", "atmosphere": {"levels": written}}}
    ).climate
    assert found == expected
    assert air_profile(found).pressure_hpa.tolist() == [row[1] for row in ROWS]
    assert found.model_dump(exclude_unset=True)["atmosphere"]["levels"]["ozone_ppm"] == (0.03, 0.1, 0.5)


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([(0.0, 1013.0, 17.0, 9000.0, 0.03), *ROWS[1:]], r"line 2: temperature_k is `17.0`, .* 120 to 1000 \(K\)"),
        ([*ROWS[:2], (100000.0, 3e-4, 195.0, 1.0, 0.5)], r"line 4: altitude_km is `100000.0`, .* to 120 \(km\)"),
        ([(0.0, 101300.0, 290.0, 9000.0, 0.03), *ROWS[1:]], r"line 2: pressure_hpa is `101300.0`, .* 1200 \(hPa\)"),
        (ROWS[::-1], "must increase"),
    ],
)
def test_levels_in_other_units_are_refused(tmp_path, rows, says):
    write(tmp_path / "my.csv", rows)
    with pytest.raises(TwilightError, match=says):
        scene(tmp_path, "{file: my.csv}")


def test_a_file_that_is_missing_or_one_thing_too_many(tmp_path):
    with pytest.raises(TwilightError, match=r"there is no file .*none\.csv"):
        scene(tmp_path, "{file: none.csv}")
    write(tmp_path / "my.csv")
    with pytest.raises(TwilightError, match="takes either file or the columns themselves"):
        scene(tmp_path, "{file: my.csv, altitude_km: [0, 100]}")
