"""atmosphere.levels from a CSV file: the same air as its columns written out, and recorded as such."""

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.climate import air_profile
from twilight.scene import resolve

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


@pytest.mark.parametrize("water", [(0.0, 0.0, 0.0), (9000.0, 0.0, 0.0), (0.0, 80.0, 1.0)])
def test_air_may_be_dry_at_some_levels_or_at_all(water):
    """Logarithms of nothing: dry air was refused, or would be no number between its levels."""
    columns = {name: list(column) for name, column in zip(COLUMNS, zip(*ROWS, strict=True), strict=True)}
    levels = columns | {"water_vapour_ppm": list(water), "ozone_ppm": [0.0, 0.0, 0.0]}
    keys = {"climate.atmosphere.levels": levels, "wavelengths": {"list_nm": [550.0, 720.0]}, "sun.elevation_deg": 20.0}
    config = load("pure-air", keys)
    profile = air_profile(config.climate)
    fine = profile.at(np.linspace(0.0, 100.0, 401))
    assert np.all(np.isfinite(fine.h2o_per_cm3)) and np.all(fine.h2o_per_cm3 >= 0.0) and not fine.o3_per_cm3.any()
    fraction = fine.h2o_per_cm3[10] / fine.air_per_cm3[10]
    assert (fraction > 0.0) == any(water[:2]) and fraction <= 1e-6 * max(water)
    medium = resolve(config).medium
    assert np.all(np.isfinite(medium.extinction_per_km)) and np.all(np.isfinite(medium.refractivity))
    for key, value, gas in (("ozone.column_du", 300.0, "ozone"), ("water_vapour.column_mm", 20.0, "water vapour")):
        if gas == "ozone" or not any(water):
            with pytest.raises(TwilightError, match=f"no {gas} at any altitude"):
                _ = resolve(load("pure-air", keys | {f"climate.gases.{key}": value})).medium
