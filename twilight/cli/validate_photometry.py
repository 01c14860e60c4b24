"""`twilight validate photometry`: illuminance and zenith luminance against measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import print_table, progress_bar

DEFAULT_CLIMATES = ("continental-average", "continental-clean")


def photometry(
    climates: Annotated[
        list[str] | None, argument("[CLIMATE...]", "Names or files; without them continental-average and -clean.")
    ] = None,
    quality: Annotated[str, option("NAME", "Preset of the solver zones.")] = "standard",
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path, option("DIR", "Folder for the tables and the picture.")] = Path("out/photometry"),
) -> None:
    """Illuminance of the ground (Janiczek and DeYoung 1987), luminance of the zenith (Koomen et al. 1952; Sky Quality
    Meter, twilight and moonlit nights) and colour of level ground (Spitschan et al. 2016).

    Writes points.csv, levels.csv, moonlit.csv and photometry.png: level and slope apart, for measured sites differ by a
    factor 1.5 to 2. With the night sky; --set night=null leaves it out.
    """
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder
    from twilight.config import load
    from twilight.studies.validate.measured import photometry as work
    from twilight.studies.validate.measured import report

    chosen: dict[str, Any] = {"night": {}, "wavelengths.list_nm": list(work.WAVELENGTHS_NM), "solver.quality": quality}
    for key, value in options.settings_of(settings)[0].items():
        if key == "night":
            chosen = {k: v for k, v in chosen.items() if not k.startswith("night.")}
        chosen[key] = value
    names = climates or list(DEFAULT_CLIMATES)
    configs = [load(name, chosen) for name in names]
    titles = [config.climate.name for config in configs]
    if len(set(titles)) < len(titles):
        raise TwilightError(f"validate photometry: the climates must have different names, not {', '.join(titles)}")
    check_folder(output)
    output.mkdir(parents=True, exist_ok=True)
    points: list[work.PhotometricPoint] = []
    moonlit: list[Any] = []
    air: list[str] = []
    with progress_bar() as progress:
        for i, config in enumerate(configs):
            part = part_of(progress, i / len(configs), 1.0 / len(configs), titles[i])
            found, by_moon, transmission = work.photometry(config, part)
            points += found
            moonlit += by_moon
            for site in work.KOOMEN_SITES:
                low, high = site.transmission
                air.append(
                    f"{titles[i]}: vertical photopic transmission above {site.name} {transmission[site.name]:.2f}, "
                    f"measured {low:.2f} to {high:.2f}"
                )
    summary = work.levels(points)
    report.write_points(points, output / "points.csv")
    report.write_levels(summary, output / "levels.csv")
    report.write_moonlit(moonlit, output / "moonlit.csv")
    report.draw(points, moonlit, output / "photometry.png")
    print_table(list(report.LEVEL_COLUMNS), report.level_rows(summary), right=tuple(range(3, 11)))
    for line in air:
        print(line)
    print(f"wrote points.csv, levels.csv, moonlit.csv, photometry.png to {output}/")
