"""Tables of benchmarks of which some rows are made anew."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
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
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import compare
    import results

    headings = iter(
        f"# twilight 0.1.0, commit {n}{n}: python benchmarks/compare.py urban --solvers some" for n in "234"
    )
    monkeypatch.setattr(results, "heading", lambda command="": next(headings))
    return compare


def merged(compare, folder, rows, columns="solver,quality,sun_elevation_deg,median_percent"):
    (folder / "made.csv").write_text("\n".join([columns, *rows]) + "\n", encoding="utf-8")
    compare.merge(folder / "made.csv", folder / "urban.csv")
    return (folder / "urban.csv").read_text(encoding="utf-8").splitlines()


def test_rows_of_some_solvers_are_replaced_and_the_others_keep_their_heading(compare, tmp_path):
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


def test_a_table_of_which_every_row_is_new_keeps_no_old_heading(compare, tmp_path):
    (tmp_path / "urban.csv").write_text(OLD, encoding="utf-8")
    lines = merged(compare, tmp_path, ["zones,draft,5,0.5", "cells,draft,5,1.9", "cie,standard,5,29.0"])
    assert not any("11111111" in line for line in lines) and lines[-1] == "cie,standard,5,29.0"


def test_a_table_of_other_columns_is_left_as_it_is(compare, tmp_path):
    (tmp_path / "urban.csv").write_text(OLD, encoding="utf-8")
    with pytest.raises(SystemExit, match=r"urban.csv: has other columns"):
        merged(compare, tmp_path, ["zones,draft,5"], columns="solver,quality,sun_elevation_deg")
    assert (tmp_path / "urban.csv").read_text(encoding="utf-8") == OLD


def test_every_benchmark_and_every_table_names_a_script_that_is_there(monkeypatch):
    """A table that nothing can renew would stay, or `renew.py` would run a script that is gone."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import renew

    assert [b.command for b in renew.BENCHMARKS.values() if not (renew.HERE / b.command.split()[0]).is_file()] == []
    stamps = [renew.STAMP.search(path.read_text(encoding="utf-8")) for path in sorted(renew.HERE.rglob("*.csv"))]
    scripts = {stamp[2] for stamp in stamps if stamp}
    assert len(scripts) > 20 and [script for script in scripts if not (renew.HERE / script).is_file()] == []


def test_the_code_of_a_table_is_all_that_makes_its_numbers(monkeypatch):
    """A table would seem new after its solver, a script that it imports, or the program that it starts has changed."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import renew

    importance, picture = renew.code_of("montecarlo_speed.py"), renew.code_of("phenomena.py")
    assert {"benchmarks/montecarlo_speed.py", "twilight/solvers/montecarlo/kernel.py"} <= set(importance)
    assert not any(file.startswith(("twilight/viewer/", "twilight/cli/")) for file in importance)
    assert {"benchmarks/sky_phenomena.py", "twilight/solvers/zones/solve.py"} <= set(picture)
    assert "twilight/cli/__init__.py" in renew.code_of("compare.py")
