"""Renew the tables of benchmarks, one after the other, and note what each took.

    python benchmarks/renew.py --list                what there is
    python benchmarks/renew.py --readme              the table of benchmarks/README.md alone
    python benchmarks/renew.py                       all, hours of processor time
    python benchmarks/renew.py zones_error compare   some
    python benchmarks/renew.py --old                 the tables whose code has had more than 50 commits since

The code of a table is its script, the scripts and modules that these import, directly or not, the data that they name
(base/digest.py), and the solvers that the scripts name in strings, `zones` where they name none; of scripts that start
the program, all of it.

Processor minutes of the command and all that it started go into benchmarks/renewed.csv, from which the table in
benchmarks/README.md is made.  A table whose code has changed is renewed or removed.
"""

from __future__ import annotations

import argparse
import functools
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import results

import twilight
from twilight.base.digest import files_of
from twilight.solvers import DEFAULT, SOLVERS

HERE = Path(__file__).parent
ROOT = HERE.parent
MOST_COMMITS = 50
"""A table is old that has more commits of its code behind it."""
COLUMNS = ("name", "processor_minutes", "wall_minutes", "commit")


class Benchmark(NamedTuple):
    """A script with its arguments, the files that it writes (from benchmarks/), and what they say."""

    command: str
    writes: str
    says: str


BENCHMARKS = {
    "montecarlo_reference": Benchmark(
        "montecarlo_reference.py",
        "reference/*.csv",
        "reference radiances (Monte-Carlo), by which all other errors are judged",
    ),
    "montecarlo_reference_check": Benchmark(
        "montecarlo_reference.py check", "reference/*.csv", "the same beside today's code, at 2 %"
    ),
    "montecarlo_speed": Benchmark("montecarlo_speed.py", "montecarlo_speed.csv", "time of Monte-Carlo to 1 %"),
    "frontier": Benchmark(
        "frontier.py", "frontier.csv, ../docs/frontier.png", "settings of `zones` tried by a search, in eight climates"
    ),
    "frontier_peers": Benchmark(
        "frontier.py peers anew",
        "frontier_peers.csv, ../docs/frontier-peers.png",
        "settings of `zones` and of sasktran2 tried by the same search on the same skies",
    ),
    "zones_error": Benchmark("zones_error.py", "zones_error.csv", "error of `zones` in thirteen climates"),
    "target_error": Benchmark(
        "target_error.py unseen",
        "target_error.csv",
        "whether `--target-error` is right in air that its table has not seen",
    ),
    "zones_study_quadrature": Benchmark(
        "zones_study.py",
        "zones_study_quadrature.csv",
        "what polar angles lose of smooth light, and what the analysis of `zones` does",
    ),
    "smooth_index": Benchmark("smooth_index.py", "smooth_index.csv", "how smooth the refracted sunbeam is"),
    "polarisation_scalar": Benchmark(
        "polarisation.py scalar", "polarisation.csv", "what leaving polarisation out costs"
    ),
    "polarisation_reference": Benchmark(
        "polarisation.py reference pure-air continental-average desert",
        "polarisation_reference.csv",
        "I, Q, U of `zones` against the reference solution",
    ),
    "polarisation_sky": Benchmark(
        "polarisation.py sky", "polarisation_sky.csv, ../docs/polarisation.png", "neutral points, zenith's polarisation"
    ),
    "polarisation_volcano": Benchmark(
        "polarisation.py volcano",
        "polarisation_volcano.csv, ../docs/polarisation-volcano.png",
        "the same under volcanic stratospheres",
    ),
    "polarisation_cost": Benchmark(
        "polarisation.py cost", "polarisation_cost.csv", "what polarisation costs in time and memory"
    ),
    "odd_air": Benchmark("odd_air.py odd 40", "odd_air.csv", "`zones` in odd air beside the reference solution"),
    "sharp_layers": Benchmark("odd_air.py layers 20", "sharp_layers.csv", "the same in layers with edges"),
    "clouds": Benchmark(
        "clouds.py", "clouds_plane.csv", "`zones` below and above decks of cloud beside doubling and adding"
    ),
    "compare": Benchmark(
        "compare.py", "compare.csv, ../docs/error-against-time.png", "error against run time of every solver"
    ),
    "prague_sky": Benchmark("prague_sky.py", "prague_sky.csv", "thirty values of the Prague sky model beside `zones`"),
    "air_mass": Benchmark("air_mass.py", "air_mass.csv", "air-mass factors of `zones` beside `montecarlo`, ten airs"),
    "wavelengths": Benchmark("wavelengths.py", "wavelengths.csv", "how few wavelengths do"),
    "hyperspectral": Benchmark(
        "hyperspectral.py", "hyperspectral.csv", "error and time of light interpolated over the spectrum"
    ),
    "clear_air": Benchmark(
        "clear_air.py climates", "clear_air.csv", "the model of all clear air beside the reference solution of climates"
    ),
    "clear_air_picture": Benchmark("clear_air.py picture", "../docs/clear-air.png", "the same as pictures"),
    "compact": Benchmark("compact.py", "compact.csv", "the model of one climate beside `zones`"),
    "cold_start": Benchmark("cold_start.py", "cold_start.csv", "how long a user waits for one sky"),
    "zones_speed": Benchmark("zones_speed.py", "zones_speed.csv", "time of `zones`: a field, and one more sky of it"),
    "sweep": Benchmark("sweep.py", "sweep.csv", "what 10,000 skies of a sweep by `compact` cost"),
    "memory": Benchmark(
        "memory.py", "memory.csv", "what `--plan` says of skies, views, terrain and series, and what they take"
    ),
    "phenomena": Benchmark("phenomena.py", "phenomena.csv, ../docs/phenomena.png", "twilight's phenomena as numbers"),
    "photometry": Benchmark(
        "photometry.py",
        "photometry/points.csv, photometry/levels.csv, photometry/moonlit.csv, ../docs/photometry.png",
        "against photometers: illuminance, the zenith, moonlit nights, spectra",
    ),
    "photometry_quarters": Benchmark(
        "photometry_quarters.py",
        "photometry/quarters.csv, photometry_quarters.png",
        "why the zenith at one site wanders from quarter to quarter: ozone, the stratosphere or the meter",
    ),
    "red_twilight": Benchmark(
        "red_twilight.py",
        "red_twilight*.csv, red_twilight_session_4.png",
        "why level ground is computed too red after sunset; screens fitted to spectra; skylines in space",
    ),
    "photos": Benchmark("photos.py ../shared/data/photos", "../docs/photos/*", "three panoramas"),
    "gallery": Benchmark("gallery.py", "../docs/gallery.md, ../docs/gallery/*", "twenty skies by their commands"),
    "dawn": Benchmark("gallery.py dawn", "../docs/dawn.jpg", "the photograph of README"),
    "sunset": Benchmark("sunset.py", "../docs/sunset.jpg", "README's first picture"),
    "photographs": Benchmark(
        "sunset.py ../shared/data/photos", "../docs/photographs.jpg", "photographs and skies in one view"
    ),
    "films": Benchmark("films.py", "../docs/films/*", "stills of three films"),
    "view": Benchmark("view.py sky.html", "../docs/view/*.jpg", "pictures of the page that `twilight view` writes"),
    "moonlight": Benchmark(
        "moonlight.py ../shared/data/dark_sky_network",
        "moonlight.csv, ../docs/moonlight.png",
        "moonlit nights against a dark site's meter",
    ),
    "crescent": Benchmark(
        "visibility.py crescent",
        "visibility_crescent.csv, ../docs/crescent.png",
        "the young moon beside Yallop's and Odeh's criteria",
    ),
    "arcus": Benchmark(
        "visibility.py arcus",
        "visibility_arcus.csv",
        "arcus visionis of Sirius, Venus and Saturn beside historical values",
    ),
    "first_light": Benchmark(
        "visibility.py dawn", "visibility_dawn.csv", "contrast of a desert's dawn beside the eye's threshold"
    ),
    "circular": Benchmark("circular.py", "circular.csv", "how large circular polarisation is"),
    "limb": Benchmark("limb.py", "limb.csv", "the limb by light scattered once and by all light, beside sasktran2"),
    "stars": Benchmark(
        "stars.py ../shared/data/photos/dikhololo_night_1k.hdr",
        "stars*.csv, stars_photograph.png",
        "cameras from stars",
    ),
    "bruneton2008_cie": Benchmark(
        "bruneton2008.py", "bruneton2008_cie.csv, ../docs/bruneton2008-cie.png", "Bruneton and Neyret's fig. 6 and 7"
    ),
    "three_papers": Benchmark("three_papers.py", "three_papers.csv", "claims of the three papers, measured"),
    "paper_figures": Benchmark("paper_figures.py", "../docs/paper-figures.jpg", "their figures that are renderings"),
    "segments": Benchmark("segments.py", "segments.csv", "aerial perspective against the reference solution"),
    "terrain": Benchmark("terrain.py", "terrain.csv", "light shafts exactly and by eq. 17 and 18"),
    "tables": Benchmark("tables.py", "tables.csv", "tables for renderers against the field that filled them"),
    "prague": Benchmark(
        "prague.py --channels 3 --start-nm 440 --nodes 1 --picture",
        "prague.csv, ../docs/prague.png",
        "files of the Prague Sky Model against the field",
    ),
}


def renew(name: str) -> tuple[float, float]:
    """Run one; (processor minutes, wall minutes).  Errors: CalledProcessError where it fails."""
    before, start = os.times(), time.perf_counter()
    script, *arguments = BENCHMARKS[name].command.split()
    subprocess.run([sys.executable, str(HERE / script), *arguments], cwd=ROOT, check=True)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return cpu / 60.0, (time.perf_counter() - start) / 60.0


def note(name: str, cpu: float, wall: float) -> None:
    """Put a run into renewed.csv, in place of the last of that name."""
    path = HERE / "renewed.csv"
    rows = {row["name"]: tuple(row.values()) for row in results.read_rows(path)} if path.exists() else {}
    rows[name] = (name, f"{cpu:.1f}", f"{wall:.1f}", results.commit().removeprefix("commit "))
    results.write(path, COLUMNS, [rows[n] for n in BENCHMARKS if n in rows], command="python benchmarks/renew.py")


def made_at(benchmark: Benchmark) -> str:
    """The commits in the first lines of the files that it writes; a word where there is no such file, or none says."""
    tables = [path for name in benchmark.writes.split(", ") if name for path in sorted(HERE.glob(name))]
    first = [path.read_text(encoding="utf-8").partition("\n")[0] for path in tables if path.suffix == ".csv"]
    commits = sorted({found[1] for line in first if (found := re.search(r"commit (\w+)", line))})
    if commits:
        return ", ".join(commits)
    if first:
        return "the table does not say"
    return "" if not benchmark.writes or "../" in benchmark.writes else "no table is kept"


CHECKED = re.compile(r"^# checked at commit (\w+)", re.MULTILINE)
"""The commit at which a table was last found to be what the code gives (results.note_check)."""
STAMP = re.compile(r"commit (\w+)(?: \(changed\))?: python benchmarks/(\S+)")
"""The commit and the script in the first line of a table."""
_LOCAL = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)
_PROGRAM = re.compile(r"""["']-m", "twilight"|twilight\.cli|^import twilight$""", re.MULTILINE)


def code_of(script: str) -> list[str]:
    """Files that the numbers of a script depend on, by their paths in the repository."""
    scripts: dict[str, str] = {}
    waiting = [Path(script).stem]
    while waiting:
        name = waiting.pop()
        file = HERE / f"{name}.py"
        if name not in scripts and name != "results" and file.is_file():
            scripts[name] = file.read_text(encoding="utf-8")
            waiting += _LOCAL.findall(scripts[name])
    text = "\n".join(scripts.values())
    program = ["twilight.cli", "twilight.api"] if _PROGRAM.search(text) else []
    solvers = [module for name, module in SOLVERS.items() if re.search(rf"[\"']{name}[\"':]", text)]
    if program or not (solvers or "twilight.solvers" in text):
        solvers.append(SOLVERS[DEFAULT])
    modules = [*scripts, *solvers, *program]
    roots = (Path(twilight.__file__).parents[1], ROOT)  # the package may be installed, outside the tree
    return sorted(
        next(file.relative_to(root).as_posix() for root in roots if file.is_relative_to(root))
        for file in files_of(*modules)
        if any(file.is_relative_to(root) for root in roots)
    )


@functools.cache
def former_names(commit: str) -> dict[str, str]:
    """The names that files of today had at a commit, where they had others."""
    moved = _git("diff", "-M", "-l4000", "--diff-filter=R", "--name-status", commit, "HEAD")
    return {new: old for _, old, new in (line.split("\t") for line in moved.splitlines())}


def in_history(commit: str, path: Path) -> str:
    """The commit, or, where a branch was merged as one commit and lost it, the one that brought it into this file."""
    known = subprocess.run(["git", "merge-base", "--is-ancestor", commit, "HEAD"], cwd=ROOT, capture_output=True)
    return commit if known.returncode == 0 else _git("log", "-1", "--format=%H", f"-S{commit}", "--", str(path)).strip()


def commits_since(commit: str, files: list[str]) -> int | None:
    """Commits after this one that changed any of these files, by their names of today or of then (None: no commit)."""
    if not commit:
        return None
    former = former_names(commit)
    names = [*files, *(former[file] for file in files if file in former)]
    return int(_git("rev-list", "--count", f"{commit}..HEAD", "--", *names))


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def ages() -> list[tuple[str, str, str, int | None]]:
    """(table, script, commit, commits of its code since) of every stamped table; None: no such script or commit."""
    sys.path.insert(0, str(HERE))
    cached_code = functools.cache(code_of)
    found: list[tuple[str, str, str, int | None]] = []
    for path in sorted(HERE.rglob("*.csv")):
        first, second = path.read_text(encoding="utf-8").split("\n", 2)[:2]
        stamp = STAMP.search(first)
        if stamp is None or path.name in ("renewed.csv", "slow_tests.csv"):  # these have a commit in each row
            continue
        commit, script = stamp.groups()
        if checked := CHECKED.search(second):
            commit = checked[1]
        commit_here = in_history(commit, path)
        count = commits_since(commit_here, cached_code(script)) if (HERE / script).is_file() else None
        found.append((path.relative_to(HERE).as_posix(), script, commit, count))
    return sorted(found, key=lambda row: -1 if row[3] is None else -row[3])


def old() -> None:
    """Print the tables that are to be renewed or removed."""
    rows = ages()
    late = [row for row in rows if row[3] is None or row[3] > MOST_COMMITS]
    for table, script, commit, count in late:
        since = "its script or its commit is gone" if count is None else f"{count} commits"
        print(f"{table:42} {script:24} {commit:10}", since)
    print(f"{len(late)} of {len(rows)} tables have more than {MOST_COMMITS} commits of their code since they were made")


def readme() -> None:
    """The table of benchmarks/README.md, between its two marks."""
    done = {row["name"]: row for row in results.read_rows(HERE / "renewed.csv")}
    lines = ["| command | writes | says | processor minutes | made at commit |", "|---|---|---|---|---|"]
    for name, b in BENCHMARKS.items():
        took = done[name]["processor_minutes"] if name in done else ""
        writes = f"`{b.writes}`" if b.writes else "what it prints"
        lines.append(f"| `python benchmarks/{b.command}` | {writes} | {b.says} | {took} | {made_at(b)} |")
    path = HERE / "README.md"
    text = path.read_text(encoding="utf-8")
    begin, end = "<!-- table -->", "<!-- end of table -->"
    head, rest = text.split(begin)
    path.write_text(f"{head}{begin}\n" + "\n".join(lines) + f"\n{end}{rest.split(end)[1]}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--readme", action="store_true")
    parser.add_argument("--old", action="store_true")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"{unknown[0]} is no benchmark; there are {', '.join(BENCHMARKS)}")
    if options.list:
        for name, b in BENCHMARKS.items():
            print(f"{name:22} {b.says}")
        return
    if options.readme:
        readme()
        return
    if options.old:
        old()
        return
    for name in options.names or BENCHMARKS:
        print(f"== {name}", flush=True)
        cpu, wall = renew(name)
        note(name, cpu, wall)
        readme()
        print(f"== {name}: {cpu:.1f} processor minutes", flush=True)


if __name__ == "__main__":
    main()
