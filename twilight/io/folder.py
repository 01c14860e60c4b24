"""The folder of a render and its files: which skies are in it, so that none that is finished is computed again.

The file `skies.jsonl` has a line for each sky whose files were begun, with no files, and one where they are finished:
its subfolder, the hash of its configuration, that of the program, its files with their sizes, and its figures.  The
line of a sky that was begun also names the files that were there before, of which no line tells.  Another line says
that the files which a series has once are a render's.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.base.formats import FORMATS, WHERE_DISC, WHERE_MOON, WHERE_POLARISED, WITH_VIEW, check_names, file_names
from twilight.base.whole_files import writing
from twilight.io.environment import environment_directions
from twilight.io.journal import Journal, open_journal, read_journal
from twilight.io.netcdf import read_sky
from twilight.io.picture import DEFAULT_VIEW, DEFAULT_WIDTH, check_options, view_directions
from twilight.io.provenance import differences
from twilight.io.rendered import Options, Rendered, ViewSource
from twilight.sky.sky import Sky

JOURNAL = "skies.jsonl"
SHEETS = ("contact-sheet.png", "series.csv", "series.nc")
"""What a series has once, made again at its end."""
FRAMES = "frames"
"""The folder of a series' files by number, also once."""
NUMBERED: tuple[str, ...] = ("sky.png", "sky.rgb.exr", "sky.view.png")


@dataclass(frozen=True)
class RequestedSky:
    """A sky that is asked for: the hash of its configuration, and the configuration itself as JSON values."""

    hash: str
    configuration: dict[str, Any]


class RenderFolder:
    """An open folder.  `finished`: figures of the skies that are finished and asked for, by subfolder."""

    def __init__(self, root: Path, code: str, finished: dict[str, dict[str, Any]], journal: Journal):
        self.root, self.finished = root, finished
        self._code, self._journal = code, journal

    def begin(self, name: str, wanted: RequestedSky) -> None:
        """Note that the files of a sky will be written: those that an interrupted render leaves are this sky's."""
        known = _last_entries(self.root).get(name)
        own = _remaining(self.root, name, known) if known else []
        before = [file.name for file in files_of_a_sky(self.root / name) if file not in own]
        line = {"sky": name, "hash": wanted.hash, "code": self._code, "files": {}, "before": before, "figures": {}}
        self._journal.write(line)
        for part in _partial_files(self.root / name):
            part.unlink(missing_ok=True)

    def file_names(self) -> dict[str, list[str]]:
        """Names of the files of each sky that is finished, by subfolder."""
        return {name: [Path(file).name for file in line["files"]] for name, line in _last_entries(self.root).items()}

    def begin_series_files(self) -> None:
        """Note that the files that a series has once will be written: those that are there are then a render's."""
        self._journal.write({"once": [*SHEETS, FRAMES]})

    def add(self, name: str, wanted: RequestedSky, files: Sequence[Path], figures: Mapping[str, Any]) -> None:
        """Note that a sky is finished: all its files are whole."""
        sizes = {file.relative_to(self.root).as_posix(): file.stat().st_size for file in files}
        line = {"sky": name, "hash": wanted.hash, "code": self._code, "files": sizes, "figures": dict(figures)}
        self._journal.write(line)


@contextmanager
def open_folder(
    root: Path, wanted: Mapping[str, RequestedSky], code: str, *, overwrite: bool
) -> Iterator[RenderFolder]:
    """The folder of a render, made where it is missing.

    wanted: the skies by subfolder ("" for the folder itself).  code: a digest of the program; what another program
    made is made again.  overwrite: compute all, and delete what else renders have written here.
    Errors: TwilightError where the folder holds anything that would be lost or would be mistaken for a part of this
    render, or where another process writes it.
    """
    with writing(root):
        if not overwrite:
            check_folder_content(root, wanted, code)
        root.mkdir(parents=True, exist_ok=True)
        with open_journal(root / JOURNAL, "another render") as journal:
            try:
                if overwrite:
                    _clear(root)
                # again: another render may have ended meanwhile
                finished = {} if overwrite else check_folder_content(root, wanted, code)
                yield RenderFolder(root, code, finished, journal)
            finally:
                # a render that has finished no sky leaves no folder
                with suppress(OSError):
                    if not any(_remaining(root, name, line) for name, line in _last_entries(root).items()):
                        (root / JOURNAL).unlink()
                        root.rmdir()


def check_folder_content(root: Path, wanted: Mapping[str, RequestedSky], code: str) -> dict[str, dict[str, Any]]:
    """Figures of the skies in a folder that need not be computed again, by subfolder; it changes nothing.

    Errors: TwilightError as `open_folder`.
    """
    lines = _last_entries(root)
    for name, line in lines.items():
        if name in wanted and line["hash"] == wanted[name].hash:
            continue
        if not _remaining(root, name, line):
            continue  # somebody has moved or deleted it
        _refuse(root, name, wanted)
    listed = {root / file for line in lines.values() for file in line["files"]}
    begun = {name for name, line in lines.items() if not line["files"]}
    files = [file for name in wanted if name not in begun for file in files_of_a_sky(root / name) if file not in listed]
    if len(wanted) > 1 and not _has_series_files(root):
        files += _series_files(root)
    if files:
        raise TwilightError(
            f"{files[0]}: is there already, and {JOURNAL} does not say of which sky; "
            "give --overwrite or another --output"
        )
    return {
        name: line["figures"]
        for name, line in lines.items()
        if name in wanted and name not in begun and line["code"] == code and _whole(root, line["files"])
    }


def files_of_a_sky(folder: Path) -> list[Path]:
    """The files in a folder that have the names of a sky's, sorted."""
    return sorted(folder / name for name in file_names() if (folder / name).is_file())


def numbered_files(folder: Path) -> list[Path]:
    """The files in a folder that have the names of a series' by number, sorted."""
    names = (name.rpartition(".") for name in NUMBERED)
    return sorted(file for stem, _, suffix in names for file in folder.glob(f"{stem}.[0-9][0-9][0-9][0-9]*.{suffix}"))


def _series_files(root: Path) -> list[Path]:
    """Files with the names of those that a series has once."""
    return [root / name for name in SHEETS if (root / name).is_file()] + numbered_files(root / FRAMES)


def _has_series_files(root: Path) -> bool:
    """Whether those are a render's, as the journal says."""
    return any(entry.get("once") for entry in read_journal(root / JOURNAL))


def _refuse(root: Path, name: str, wanted: Mapping[str, RequestedSky]) -> None:
    place = root / name
    if name in wanted:
        key = _difference(_configuration(place / "sky.h5"), wanted[name].configuration)
        raise TwilightError(f"{place}: holds another sky{key}; give --overwrite or another --output")
    raise TwilightError(
        f"{place}: holds a sky that is not part of this render; --overwrite deletes it, or give another --output"
    )


def _last_entries(root: Path) -> dict[str, dict[str, Any]]:
    """What the journal says of each sky, the last time that it was written."""
    entries = {}
    for line in read_journal(root / JOURNAL):
        with suppress(KeyError, TypeError, AttributeError):
            name, files = str(line["sky"]), {str(k): int(v) for k, v in line["files"].items()}
            line["figures"] = dict(line["figures"])
            if all(_inside(file) for file in (name, *files)):
                texts = {key: str(line[key]) for key in ("hash", "code")}
                entries[name] = {**line, **texts, "files": files, "before": [str(f) for f in line.get("before", [])]}
    return entries


def _inside(name: str) -> bool:
    """Whether a name of the journal stays in the folder."""
    return not Path(name).is_absolute() and ".." not in Path(name).parts


def _whole(root: Path, files: Mapping[str, int]) -> bool:
    return all((root / file).is_file() and (root / file).stat().st_size == size for file, size in files.items())


def _remaining(root: Path, name: str, line: Mapping[str, Any]) -> list[Path]:
    """Files of a sky's line that are still there; of one that was only begun, those with the names of a sky's that were
    not there before, and what was being written."""
    if line["files"]:
        return [root / file for file in line["files"] if (root / file).is_file()]
    own = [file for file in files_of_a_sky(root / name) if file.name not in line["before"]]
    return own + _partial_files(root / name)


def _partial_files(folder: Path) -> list[Path]:
    """What a killed process was writing of a sky's files (`whole_file`)."""
    return [part for part in folder.glob(".*.part*") if any(part.name.startswith(f".{name}.") for name in file_names())]


def _clear(root: Path) -> None:
    """Delete what renders have written, as the journal says, and the folders that are then empty."""
    for name, line in _last_entries(root).items():
        for file in _remaining(root, name, line):
            file.unlink(missing_ok=True)
        folder = root / line["sky"]
        while folder != root:
            with suppress(OSError):
                folder.rmdir()
            folder = folder.parent
    if _has_series_files(root):
        for file in _series_files(root):
            file.unlink(missing_ok=True)
        with suppress(OSError):
            (root / FRAMES).rmdir()
    (root / JOURNAL).write_text("", encoding="utf-8")


def _configuration(path: Path) -> dict[str, Any] | None:
    """The configuration inside a sky's file, None where there is none."""
    try:
        return read_sky(path).provenance.get("configuration")
    except TwilightError:
        return None


def _difference(there: Any, asked: Any) -> str:
    """` (ground.albedo is 0.2, asked is 0.5)` for the first key in which two configurations differ."""
    if there is None:
        return ""
    for path, a, b in differences(there, json.loads(json.dumps(asked))):
        return f" ({'.'.join(path).removeprefix('climate.')} is {_short(a)}, asked is {_short(b)})"
    return ""


def _short(value: Any) -> str:
    text = "unset" if value is None else json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def write_outputs(
    sky: Sky,
    folder: str | Path,
    *,
    view: ViewSource | None = None,
    files: Sequence[str] | None = None,
    views: Sequence[str] = (DEFAULT_VIEW,),
    **options: Any,
) -> list[Path]:
    """Write files of a sky into a folder, which is made if it is not there; each is whole or absent.  Returns them.

    sky: what ``sky.h5`` holds, and pictures and environment maps are made from.  view: what `engine.view` saw, for the
    file `view`.  files: names of `twilight.base.formats.FORMATS`; None: all of them, without pictures of the
    polarisation, the disc and a view where there is none; with `view` those of a view alone.  views, options: as of
    `twilight.io.rendered.Options`.
    Errors: TwilightError for an unknown option, and where the folder cannot be written.
    """
    folder = Path(folder)
    try:
        chosen = check_names(tuple(FORMATS.own if files is None else files))
    except ValueError as error:
        raise TwilightError(f"files: {error}") from None
    if files is None and view is not None:
        chosen = WITH_VIEW if sky.moon is None else WITH_VIEW + WHERE_MOON
    elif files is None:
        without = {"view"}
        without.update(WHERE_POLARISED if sky.polarisation is None else ())
        without.update(WHERE_MOON if sky.moon is None else ())
        without.update(WHERE_DISC if sky.disc is None else ())
        chosen = tuple(name for name in chosen if name not in without)
    elif "view" in chosen and view is None:
        raise TwilightError("output.files: view needs a view of the observer (observer.view)")
    o = Options(views=tuple(views), **options)
    check_options(o.exposure, o.tone_mapping, o.observer)
    for name in views:
        view_directions(name, DEFAULT_WIDTH.get(name, 4))
    for size in (o.width, o.spectral_width):
        environment_directions(o.renderer, size)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TwilightError(f"{folder}: the folder cannot be made ({error.strerror or error})") from error
    rendered = Rendered(sky, o.polariser_deg, view)
    chosen = tuple(sorted(chosen, key=list(FORMATS).index))  # the map before those who refer to it
    written = [path for name in chosen for path in FORMATS.load(name)(rendered, folder, o)]
    for path in written:
        if path.name not in file_names():
            raise TwilightError(f"{path}: is a file that none of the formats {', '.join(chosen)} declares")
    return written
