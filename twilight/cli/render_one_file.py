"""`twilight render --output evening.nc`: the skies of all suns in one file, in place of a folder each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.cli.terminal import print_table, progress_bar

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
    from twilight.cli.render_files import TABLE, cell
    from twilight.engine import frames
    from twilight.io.provenance import provenance_fields
    from twilight.io.series import figures, write_series
    from twilight.scene import resolve
    from twilight.scene.record import resolved_configuration

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
