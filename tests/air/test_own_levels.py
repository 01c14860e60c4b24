"""atmosphere.levels from a CSV file: the same air as its columns written out, and recorded as such."""

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
    """A file of levels would be other air than its columns."""
    write(tmp_path / "my.csv")
    found = scene(tmp_path, "{file: my.csv}").climate
    written = {name: list(column) for name, column in zip(COLUMNS, zip(*ROWS, strict=True), strict=True)}
    expected = load(
        {"version": 1, "climate": {"version": 1, "name": "mine", "atmosphere": {"levels": written}}}
    ).climate
    assert found == expected
    assert air_profile(found).pressure_hpa.tolist() == [row[1] for row in ROWS]
    assert found.model_dump(exclude_unset=True)["atmosphere"]["levels"]["ozone_ppm"] == (0.03, 0.1, 0.5)
