"""The work of `twilight render`: the skies that a folder lacks, and the files of a series.

With `--output evening.nc` the skies of all suns are written to one file in place of a folder each.
"""

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.cli.preview import PREVIEW
from twilight.cli.terminal import print_table, progress_bar

LONGEST_NAME = 120
"""Characters of a folder that is named after its settings."""
TABLE = (
    ("scene", None, ""),
    ("sun [deg]", "sun_elevation_deg", "+.2f"),
    ("zenith [cd m^-2]", "zenith_luminance_cd_per_m2", ".4g"),
    ("zenith [V mag arcsec^-2]", "zenith_magnitude_v_per_arcsec2", ".2f"),
    ("illuminance of the sky [lx]", "sky_illuminance_lux", ".4g"),
    ("time [s]", "run_time_s", ".1f"),
)


@dataclass(frozen=True)
class _SkyToRender:
    """One sky of a render: its case, the name of its sun, its subfolder and its label."""

    case: Any
    sun: str
    folder: str
    label: str


def check_cases(cases: Sequence[Any]) -> None:
    """TwilightError for what is too large, and for files that cannot be made from the others."""
    from twilight.engine import check_size

    for case in cases:
        check_size(case.config)
        lacks = {"png", "h5"} - set(case.config.output.files or ("png", "h5"))
        if _by_series(case.config) and lacks:
            names = ", ".join(sorted(lacks))
            raise TwilightError(f"output.exposure: series draws its pictures from sky.h5; add {names}")


def render_files(
    cases: Sequence[Any],
    scene: str,
    settings: Mapping[str, Any],
    output: Path | None,
    overwrite: bool,
    preview: Callable[[Any, str, Path], AbstractContextManager[None]] | None = None,
) -> None:
    """Render all cases into one folder; a sky that is there, of the same configuration and program, is kept.

    preview: shows one for the first sky that is not there, by its configuration, sun and folder, while it is computed.
    """
    from twilight.base.whole_files import check_folder
    from twilight.io.folder import JOURNAL, open_folder
    from twilight.scene.usual import said

    skies, wanted = _requested_skies(cases)
    root = output or _default_folder(cases, scene, settings, skies)
    check_folder(root)
    with open_folder(root, wanted, _code_digest(cases), overwrite=overwrite) as folder, progress_bar() as progress:
        first = next((one for one in skies if one.folder not in folder.finished), None)
        shown = preview(first.case.config, first.sun, root / first.folder) if preview and first else nullcontext()
        with shown:
            rows = _compute(cases, skies, wanted, folder, progress)
        rows = {one.folder: rows[one.folder] for one in skies}
        with_one_exposure = [one for one in skies if _by_series(one.case.config)] if len(skies) > 1 else []
        if with_one_exposure:
            _expose_together(with_one_exposure, wanted, rows, folder, progress)
        labels = {one.label: rows[one.folder] for one in skies}
        once, notes = _write_series_files(skies, labels, folder, progress) if len(skies) > 1 else ([], [])
    finished = len(folder.finished)
    if finished:
        print(f"twilight: {finished} of {len(skies)} were there already ({JOURNAL}); --overwrite computes them again",
              file=sys.stderr)  # fmt: skip
    cells = [[label, *(cell(row.get(key), form) for _, key, form in TABLE[1:])] for label, row in labels.items()]
    print_table([head for head, _, _ in TABLE], cells, right=tuple(range(1, len(TABLE))))
    errors = [row["estimated_error"] for row in rows.values() if row.get("estimated_error")]
    if errors:
        print(f"by its own estimate, 95 % of the directions are within {100 * max(errors):.2g} %")
    for note in [*dict.fromkeys(words for case in cases for words in said(case.config)), *notes]:
        print(note)
    names = folder.file_names()
    what = ", ".join(sorted({name for one in skies for name in names[one.folder]}))
    more = f" in {len(skies)} folders, and {', '.join(once)}" if len(skies) > 1 else ""
    print(f"wrote {what}{more} to {root}{'' if str(root).endswith('/') else '/'}")


def cell(value: Any, form: str) -> str:
    """A figure of `TABLE` as text."""
    return "-" if value is None else format(value, form)


def _requested_skies(cases: Sequence[Any]) -> tuple[list[_SkyToRender], dict[str, Any]]:
    """All skies in their order, and what each is, by subfolder."""
    from twilight.io.folder import RequestedSky
    from twilight.io.provenance import configuration_hash
    from twilight.scene.scene import resolved_configuration
    from twilight.scene.suns import count_suns, suns_of

    skies, wanted = [], {}
    for case in cases:
        several = count_suns(case.config) > 1
        for sun in suns_of(case.config):
            name = "/".join(part for part in (case.name, sun.name if several else "") if part)
            label = " ".join(part for part in (case.name, sun.name) if part)
            if name in wanted:
                raise TwilightError(f"sun: two suns have the name {sun.name}; they are less than 0.005 deg apart")
            configuration = resolved_configuration(case.config, sun.section)
            wanted[name] = RequestedSky(configuration_hash(configuration), configuration)
            skies.append(_SkyToRender(case, sun.name, name, label))
    return skies, wanted


def _code_digest(cases: Sequence[Any]) -> str:
    """A digest of what the skies and their files are made by."""
    from twilight import solvers
    from twilight.base.digest import code_digest

    names = sorted({case.config.chosen_solver.name for case in cases})
    return code_digest("twilight.engine.frames", "twilight.io.folder", *(solvers.SOLVERS[name] for name in names))


def _by_series(config: Any) -> bool:
    return config.output.exposure == "series" and config.output.exposure_ev100 is None


def _compute(
    cases: Sequence[Any], skies: Sequence[_SkyToRender], wanted: Mapping[str, Any], folder: Any, progress: Any
) -> dict[str, dict[str, Any]]:
    """The figures of all skies by subfolder, computed and written where they are not there."""
    from twilight.base.progress import part_of
    from twilight.engine import frames
    from twilight.io.series import figures
    from twilight.scene import resolve

    rows = dict(folder.finished)
    missing = [one for one in skies if one.folder not in rows]
    done = 0
    for case in cases:
        of_case = {one.sun: one for one in missing if one.case is case}
        if not of_case:
            continue
        report = part_of(progress, done / len(missing), len(of_case) / len(missing), case.name)
        for frame in frames(resolve(case.config), report, wanted=of_case.keys()):
            one = of_case[frame.name]
            folder.begin(one.folder, wanted[one.folder])
            files = _write(frame, case.config, folder.root / one.folder)
            (folder.root / one.folder / PREVIEW).unlink(missing_ok=True)
            rows[one.folder] = figures(frame.sky)
            folder.add(one.folder, wanted[one.folder], files, rows[one.folder])
        done += len(of_case)
    return rows


def _write(frame: Any, config: Any, folder: Path, exposure: float | None = None, files: Any = None) -> list[Path]:
    from twilight.io.folder import write_outputs

    o = config.output
    given = o.exposure_ev100 if exposure is None else exposure
    return write_outputs(
        frame.sky,
        folder,
        view=frame.view,
        files=files or o.files,
        polariser_deg=o.polariser_deg,
        disc=o.disc,
        tone_settings={name: getattr(o, name).model_dump() for name in ("eye", "camera")},
        views=o.views,
        renderer=o.renderer,
        primaries=o.primaries,
        exr=o.exr,
        width=o.width,
        spectral_width=o.spectral_width,
        exposure="auto" if given is None else given,
        tone_mapping=o.tone_mapping,
        observer=o.colour_observer,
    )


def _expose_together(
    skies: Sequence[_SkyToRender], wanted: Mapping[str, Any], rows: dict[str, Any], folder: Any, progress: Any
) -> None:
    """Draw the pictures of a series again with one exposure, that of its brightest sky, from their sky.h5."""
    from twilight.engine import Frame
    from twilight.io import read_sky
    from twilight.io.folder import files_of_a_sky
    from twilight.io.picture import render_view

    progress("one exposure for all", 1.0)
    exposures = {}
    for one in skies:
        o = one.case.config.output
        sky = read_sky(folder.root / one.folder / "sky.h5")
        exposures[one.folder] = render_view(sky, view=o.views[0], width=200, observer=o.colour_observer)[1]
    brightest = max(exposures.values())
    for one in skies:
        path = folder.root / one.folder
        frame = Frame(one.sun, read_sky(path / "sky.h5"))
        _write(frame, one.case.config, path, brightest, files=("png",))
        files = files_of_a_sky(path)
        folder.add(one.folder, wanted[one.folder], files, rows[one.folder])


def _write_series_files(
    skies: Sequence[_SkyToRender], labels: Mapping[str, Any], folder: Any, progress: Any
) -> tuple[list[str], list[str]]:
    """The files that a series has once; sentences about those that it cannot have."""
    from twilight.api.representation import contact_sheet
    from twilight.io.folder import FRAMES
    from twilight.io.series import number_files, write_dataset, write_table

    progress("the series", 1.0)
    root = folder.root
    folder.begin_series_files()
    folders = dict(zip(labels, (root / one.folder for one in skies), strict=True))
    names, notes = ["series.csv"], []
    write_table(labels, root / "series.csv")
    if all((folder / "sky.png").is_file() for folder in folders.values()):
        contact_sheet([(label, folder / "sky.png") for label, folder in folders.items()], root / "contact-sheet.png")
        names.append("contact-sheet.png")
    if all((folder / "sky.h5").is_file() for folder in folders.values()):
        why = write_dataset({label: folder / "sky.h5" for label, folder in folders.items()}, root / "series.nc")
        names += [] if why else ["series.nc"]
        notes += [f"no series.nc: {why}"] if why else []
    if number_files(list(folders.values()), root / FRAMES):
        names.append(f"{FRAMES}/")
    return names, notes


def _default_folder(
    cases: Sequence[Any], scene: str, settings: Mapping[str, Any], skies: Sequence[_SkyToRender]
) -> Path:
    """`out/NAME_SUN`, with the settings that make it another sky than NAME's."""
    from twilight.config.vary import label
    from twilight.io.provenance import configuration_hash

    config = cases[0].config
    name = f"{config.title}_{skies[0].sun}" if len(skies) == 1 else (config.name or Path(scene).stem)
    for key, value in settings.items():
        if key.split(".")[0] not in ("sun", "output", "vary"):
            name += f"_{label(key, value)}"
    name = re.sub(r"[^\w.=+-]+", "-", name).strip("-.") or "sky"
    if len(name) > LONGEST_NAME:
        name = f"{name[:LONGEST_NAME]}-{configuration_hash(dict(settings))[:8]}"
    return Path("out") / name


SUFFIX = ".nc"
"""An --output that ends so is a file."""


def check_one_file(cases: Sequence[Any], scene: str, names: Mapping[str, str], path: Path, overwrite: bool) -> None:
    """TwilightError for what one file cannot hold, and where it cannot be written.

    names: what each key that was set is called.
    """
    from twilight.base.whole_files import check_file

    if len(cases) > 1:
        raise TwilightError(
            f"--output {path}: holds the suns of one scene, and {scene} is a series of {len(cases)} (vary); give a "
            "folder, or take `twilight sweep`"
        )
    for key, name in names.items():
        if key.startswith(("output.", "observer.view", "sun.disc")):
            raise TwilightError(f"--output {path}: holds radiances alone, and {name} is of other files; leave it out")
    if path.exists() and not overwrite:
        raise TwilightError(f"{path}: is there already; give --overwrite or another --output")
    check_file(path)


def render_one_file(config: Any, path: Path) -> None:
    """Compute the skies of all suns and write them."""
    from twilight.base.progress import part_of
    from twilight.engine import frames
    from twilight.io.provenance import provenance_fields
    from twilight.io.series import figures, write_series
    from twilight.scene import resolve
    from twilight.scene.scene import resolved_configuration

    config = config.model_copy(update={"observer": config.observer.model_copy(update={"view": None})})
    scene = resolve(config)
    rows = []
    with progress_bar() as progress:

        def skies() -> Iterator[Any]:
            for frame in frames(scene, part_of(progress, 0.0, 0.95)):
                row = {"scene": frame.name, **figures(frame.sky)}
                rows.append([cell(row.get(key), form) if key else row["scene"] for _, key, form in TABLE])
                yield frame.sky

        record = {"configuration": resolved_configuration(config, config.sun)}
        record |= dict(zip(("solver", "quality"), config.chosen_solver[:2], strict=True))
        write_series(skies(), path, provenance_fields(record), len(scene.suns))
    print_table([head for head, _, _ in TABLE], rows, right=tuple(range(1, len(TABLE))))
    suns = "1 sun" if len(rows) == 1 else f"{len(rows)} suns"
    print(f"wrote the radiances of {suns} to {path} ({path.stat().st_size / 1e6:.3g} MB)")
