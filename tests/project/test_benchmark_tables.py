"""Tables of benchmarks of which some rows are made anew."""

import re
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[2] / "benchmarks"
OLD = """# twilight 0.1.0, commit 11111111: python benchmarks/compare.py urban
# a busy machine: read processor seconds
solver,quality,sun_elevation_deg,median_percent
zones,draft,5,1.0
zones,draft,0,1.1
cells,draft,5,2.0
cie,standard,5,30.0
"""


@pytest.fixture
def compare(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    import compare
    import results

    headings = iter(f"twilight 0.1.0, commit {n}{n}: python benchmarks/compare.py urban --solvers some" for n in "234")
    monkeypatch.setattr(results, "heading", lambda command="": next(headings))
    return compare


def merged(compare, folder, rows, columns="solver,quality,sun_elevation_deg,median_percent"):
    (folder / "made.csv").write_text("\n".join([columns, *rows]) + "\n", encoding="utf-8")
    compare.merge(folder / "made.csv", folder / "urban.csv")
    return (folder / "urban.csv").read_text(encoding="utf-8").splitlines()


def test_rows_of_some_solvers_are_replaced_and_the_others_keep_their_heading(compare, tmp_path):
    """Rows of two commits would stand under one heading."""
    (tmp_path / "urban.csv").write_text(OLD, encoding="utf-8")
    new = ["zones,draft,5,0.5", "zones,draft,0,0.6"]
    assert merged(compare, tmp_path, new) == [
        "# twilight 0.1.0, commit 22: python benchmarks/compare.py urban --solvers some",
        "# rows of cells:draft, cie:standard: twilight 0.1.0, commit 11111111: python benchmarks/compare.py urban",
        "# a busy machine: read processor seconds",
        "solver,quality,sun_elevation_deg,median_percent",
        *("cells,draft,5,2.0", "cie,standard,5,30.0", *new),
    ]
    # the same again, and other rows: every row is named once, under the heading of the run that made it
    merged(compare, tmp_path, ["cells,draft,5,1.9"])
    lines = merged(compare, tmp_path, ["cells,standard,5,0.2"])
    assert [line for line in lines if line.startswith("# rows")] == [
        "# rows of cie:standard: twilight 0.1.0, commit 11111111: python benchmarks/compare.py urban",
        "# rows of zones:draft: twilight 0.1.0, commit 22: python benchmarks/compare.py urban --solvers some",
        "# rows of cells:draft: twilight 0.1.0, commit 33: python benchmarks/compare.py urban --solvers some",
    ]
    assert lines[6:] == ["cie,standard,5,30.0", *new, "cells,draft,5,1.9", "cells,standard,5,0.2"]


def test_rows_of_a_table_without_a_new_column_stay_empty_there(compare, tmp_path):
    """A column that is new would end the table, or stand under another's name."""
    (tmp_path / "urban.csv").write_text(OLD, encoding="utf-8")
    columns = "solver,quality,sun_elevation_deg,sky_cpu_s,median_percent"
    lines = merged(compare, tmp_path, ["zones,draft,5,0.2,0.5", "zones,draft,0,0.3,0.6"], columns)
    assert lines[3:] == [
        columns,
        "cells,draft,5,,2.0",
        "cie,standard,5,,30.0",
        "zones,draft,5,0.2,0.5",
        "zones,draft,0,0.3,0.6",
    ]


def test_every_benchmark_and_every_table_names_a_script_that_is_there():
    """A table that nothing can renew would stay, or README would name a script that is gone."""
    listed = re.findall(
        r"^\| `python benchmarks/(\S+?\.py)", (HERE / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    first = (path.read_text(encoding="utf-8").partition("\n")[0] for path in HERE.rglob("*.csv"))
    stamped = [found[1] for line in first if (found := re.search(r": python benchmarks/(\S+)", line))]
    assert len(listed) > 20 and len(stamped) > 20
    assert [script for script in {*listed, *stamped} if not (HERE / script).is_file()] == []


def test_every_file_of_long_tests_has_a_row_without_a_failure(monkeypatch):
    """A record of other files than there are would spread the long tests by times that nobody measured."""
    monkeypatch.syspath_prepend(HERE)
    import reliability
    import results

    rows = {row["file"]: row for row in results.read_rows(reliability.TESTS)}
    assert sorted(rows) == reliability.slow_files()
    assert [file for file, row in rows.items() if int(row["failed"]) or not int(row["long_tests"])] == []
