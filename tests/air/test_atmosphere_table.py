"""Tabulated media: what is read, how it is interpolated, and one sentence for every malformed table."""

from pathlib import Path

import numpy as np
import pytest

from twilight.atmosphere.medium_table import COLUMNS, MAX_PHASE_FUNCTIONS, medium_from_table
from twilight.base.errors import TwilightError

HEADER = ",".join(COLUMNS)


def row(z, w, air=0.01, ext=0.1, ssa=0.9, g=0.7, absorption=1e-3, refractivity=2e-4):
    return [z, w, air * np.exp(-z / 8), ext * np.exp(-z / 2), ssa, g, absorption, refractivity * np.exp(-z / 8)]


def text_of(rows, header=HEADER):
    return header + "\n" + "\n".join(",".join(repr(float(x)) for x in r) for r in rows) + "\n"


def table(tmp_path, rows, header=HEADER):
    path = tmp_path / "t1.csv"
    path.write_text(text_of(rows, header))
    return path


GRID = [row(z, w) for z in (0.0, 1.0, 5.0, 100.0) for w in (450.0, 550.0, 650.0)]


def test_values_arrive_where_they_belong(tmp_path):
    """A column of a table would arrive in another coefficient, level or wavelength."""
    rows = [row(z, w, ssa=0.5 + w / 2000, g=0.6 + w / 10000) for z in (0.0, 1.0, 5.0) for w in (450.0, 550.0)]
    medium = medium_from_table(table(tmp_path, rows), ground_albedo=0.2, depolarisation=0.03, name="T1")
    np.testing.assert_array_equal(medium.altitude_km, [0, 1, 5])
    np.testing.assert_array_equal(medium.wavelength_nm, [450, 550])
    for key, column in (
        ("air_scattering_per_km", 2),
        ("aerosol_extinction_per_km", 3),
        ("aerosol_single_scattering_albedo", 4),
        ("absorption_per_km", 6),
        ("refractivity", 7),
    ):
        np.testing.assert_array_equal(getattr(medium, key), np.array(rows)[:, column].reshape(3, 2), key)
    assert len(medium.phase_functions) == 1
    np.testing.assert_allclose(medium.phase_functions[0].asymmetry, [0.645, 0.655])
    assert medium.name == "T1" and np.all(medium.ground_albedo == 0.2) and np.all(medium.depolarisation == 0.03)
    # between levels: exponentially
    at = medium.at([2.0])
    assert at.aerosol_extinction[0, 0] == pytest.approx(0.1 * np.exp(-1.0), rel=1e-12)


def test_order_of_rows_columns_and_comments_does_not_matter(tmp_path):
    """The order of rows or columns would change the air."""
    plain = medium_from_table(table(tmp_path, GRID))
    by_wavelength = sorted(GRID, key=lambda r: (r[1], r[0]))
    downwards = sorted(GRID, key=lambda r: -r[0])
    for rows in (by_wavelength, downwards):
        other = medium_from_table(table(tmp_path, rows))
        np.testing.assert_array_equal(other.altitude_km, plain.altitude_km)
        np.testing.assert_array_equal(other.refractivity, plain.refractivity)
    names = list(COLUMNS)
    turned = [list(reversed(r)) for r in GRID]
    path = tmp_path / "t2.csv"
    text = text_of(turned, ",".join(reversed(names)))
    path.write_text("﻿# made by hand\n\n" + text.replace("\n", "\r\n# a comment\r\n", 3))
    other = medium_from_table(path)
    np.testing.assert_array_equal(other.air_scattering_per_km, plain.air_scattering_per_km)


def test_coefficient_that_ends_is_linear_and_outside_is_vacuum(tmp_path):
    """An end or a jump would be smeared, or a table without aerosol need a phase function."""
    rows = [row(0.0, 550.0), row(2.0, 550.0, ext=0.0), row(10.0, 550.0, ext=0.0)]
    medium = medium_from_table(table(tmp_path, rows))
    assert medium.at([1.0]).aerosol_extinction[0, 0] == pytest.approx(0.05)
    assert medium.at([10.1]).extinction[0, 0] == 0 and medium.at([-0.1]).extinction[0, 0] == 0
    rows = [row(0.0, 550.0), row(2.0, 550.0), row(2.0, 550.0, ext=0.001), row(10.0, 550.0, ext=0.0)]
    medium = medium_from_table(table(tmp_path, rows))
    below, above = medium.at([2.0 - 1e-12, 2.0]).aerosol_extinction[:, 0]
    assert below == pytest.approx(100 * above, rel=1e-9)
    medium = medium_from_table(table(tmp_path, [row(z, 550.0, ext=0.0) for z in (0.0, 50.0)]))
    assert medium.phase_functions == () and not medium.has_aerosol


def test_asymmetry_by_level_is_exact_at_the_levels(tmp_path):
    """The mixture of phase functions would not have the asymmetry of the table."""
    g = {0.0: 0.75, 1.0: 0.6, 5.0: 0.6, 100.0: -0.1}
    rows = [row(z, w, g=g[z] if w < 600 else 0.5) for z in g for w in (450.0, 650.0)]
    medium = medium_from_table(table(tmp_path, rows))
    assert len(medium.phase_functions) == 3
    np.testing.assert_allclose(medium.aerosol_phase_fraction.sum(axis=0), 1.0)
    node = np.array([p.asymmetry for p in medium.phase_functions])
    mean = np.einsum("klw,kw->lw", medium.aerosol_phase_fraction, node)
    np.testing.assert_allclose(mean[:, 0], list(g.values()), rtol=1e-12)
    np.testing.assert_allclose(mean[:, 1], 0.5, rtol=1e-12)
    # one function alone at every level: the mixture is that Henyey-Greenstein function itself
    assert np.all(np.sort(medium.aerosol_phase_fraction[:, :, 0], axis=0)[-1] == 1.0)


def test_many_asymmetries_share_a_grid(tmp_path):
    """Many asymmetries would need as many phase functions."""
    z = np.linspace(0, 20, 41)
    g = 0.8 - 0.02 * z
    rows = [row(a, 550.0, g=b) for a, b in zip(z, g, strict=True)]
    medium = medium_from_table(table(tmp_path, rows))
    assert len(medium.phase_functions) == MAX_PHASE_FUNCTIONS
    node = np.array([p.asymmetry[0] for p in medium.phase_functions])
    np.testing.assert_allclose(node @ medium.aerosol_phase_fraction[:, :, 0], g, rtol=1e-12)


def test_other_wavelengths(tmp_path):
    """Wavelengths between those of the table would not follow its rule, or those outside would be computed."""
    path = table(tmp_path, [row(z, w, air=0.01 * (w / 550) ** -4) for z in (0.0, 50.0) for w in (400.0, 500.0, 700.0)])
    own = medium_from_table(path)
    same = medium_from_table(path, wavelength_nm=[400.0, 500.0, 700.0])
    np.testing.assert_array_equal(same.air_scattering_per_km, own.air_scattering_per_km)
    between = medium_from_table(path, wavelength_nm=[450.0, 633.0])
    np.testing.assert_allclose(
        between.air_scattering_per_km[0], 0.01 * (np.array([450, 633]) / 550) ** -4.0, rtol=1e-10
    )
    for outside in ([399.0, 500.0], [500.0, 701.0]):
        with pytest.raises(TwilightError, match=r"t1\.csv.*400 to 700"):
            medium_from_table(path, wavelength_nm=outside)
    with pytest.raises(TwilightError, match="increase"):
        medium_from_table(path, wavelength_nm=[500.0, 450.0])


def replaced(position, value):
    rows = [list(r) for r in GRID]
    rows[4][position] = value
    return text_of(rows).replace("'nan'", "nan")


MALFORMED = {
    "empty": ("", "empty"),
    "only comments": ("# nothing\n\n", "empty"),
    "no rows": (HEADER + "\n", "no rows"),
    "missing column": (text_of([r[:-1] for r in GRID], HEADER.rsplit(",", 1)[0]), "refractivity is missing"),
    "unknown column": (text_of([[*r, 1.0] for r in GRID], HEADER + ",colour"), "`colour` is not known"),
    "column twice": (text_of([[*r, 1.0] for r in GRID], HEADER + ",refractivity"), "more than once"),
    "short row": (HEADER + "\n0,550,0.1\n", "line 2 has 3 values, expected 8"),
    "text": (text_of(GRID).replace("450.0", "blue", 1), r"line 2: wavelength_nm is `blue`"),
    "nan": (replaced(3, np.nan), "line 6: aerosol_extinction_per_km is `nan`"),
    "infinite": (replaced(7, np.inf), "line 6: refractivity is `inf`"),
    "negative": (replaced(6, -1e-6), "line 6: absorption_per_km is `-1e-06`, allowed is a number from 0"),
    "albedo": (
        replaced(4, 1.01),
        "line 6: aerosol_single_scattering_albedo is `1.01`, allowed is a number from 0 to 1",
    ),
    "asymmetry": (replaced(5, 1.0), "line 6: aerosol_asymmetry is `1.0`"),
    "wavelength": (replaced(1, 0.55), "line 6: wavelength_nm is `0.55`"),
    "missing row": (text_of(GRID[:4] + GRID[5:]), "no row for altitude_km 1 and wavelength_nm 550"),
    "row twice": (text_of([*GRID[:5], GRID[4], *GRID[5:]]), "only one of two rows for altitude_km 1"),
    "row thrice": (text_of([*GRID[:5], GRID[4], GRID[4], *GRID[5:]]), "more than twice"),
    "up and down": (text_of([row(z, 550.0) for z in (0, 2, 1, 5)]), "line 4: altitude_km goes both up and down"),
    "one altitude": (text_of([row(0, 450.0), row(0, 550.0)]), "one altitude"),
    "quotes": (HEADER + '\n"0,550,0,0,0,0,0,0\n', "line 2"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_table_gives_one_sentence(tmp_path, name):
    """A malformed table would not be refused in a sentence with file and line."""
    text, message = MALFORMED[name]
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(TwilightError, match=message) as caught:
        medium_from_table(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_file_that_is_not_a_table(tmp_path):
    """A file that is no table would end in a traceback."""
    with pytest.raises(TwilightError, match="cannot read"):
        medium_from_table(tmp_path / "absent.csv")
    with pytest.raises(TwilightError, match="cannot read"):
        medium_from_table(tmp_path)
    path = tmp_path / "picture.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(TwilightError, match="UTF-8"):
        medium_from_table(path)


def test_table_that_is_too_large(tmp_path, monkeypatch):
    """A huge table would be read into memory."""
    path = table(tmp_path, GRID)
    monkeypatch.setattr("twilight.atmosphere.csv_columns.MAX_ROWS", 5)
    with pytest.raises(TwilightError, match="12 rows, at most 5"):
        medium_from_table(path)
    monkeypatch.setattr("twilight.atmosphere.csv_columns.MAX_BYTES", 100)
    for file in (path, Path("/dev/zero")):  # a device has no size, and no end
        with pytest.raises(TwilightError, match="larger than"):
            medium_from_table(file)


@pytest.mark.parametrize("options", [{"ground_albedo": -0.1}, {"ground_albedo": [0.1, 0.1]}, {"depolarisation": 1.5}])
def test_bad_options(tmp_path, options):
    """An impossible albedo or depolarisation would be computed."""
    with pytest.raises(TwilightError, match=r"between 0 and 1|values"):
        medium_from_table(table(tmp_path, GRID), **options)
