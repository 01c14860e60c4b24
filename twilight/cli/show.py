"""`twilight show`: climates, configurations, solvers, the layout of documents, the air of one climate."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import print_table

DESCRIBED_NM = (300.0, 350.0, 400.0, 450.0, 550.0, 650.0, 800.0, 1000.0)
"""Wavelengths of the optical depths that are printed, over the whole range; 550 nm is the one of the profile."""


def show(
    what: Annotated[
        str,
        argument(
            "climates|configs|solvers|schema|NAME",
            "A list, the layout of a document, or a climate or configuration by its name or file.",
            options.shown_names,
        ),
    ],
    name: Annotated[
        str | None, argument("NAME", "After solvers: which one; after schema: climate or configuration.")
    ] = None,
    scene: Annotated[
        str | None,
        argument(
            "SCENE", "After a solver: a climate or configuration, to print the tuned numbers that act in its air."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None, option("KEY=VALUE", "Of one climate or SCENE: any of its keys; may be repeated.", "--set")
    ] = None,
    output: Annotated[
        Path | None, option("FILE.png", "Of one climate: its profile; without it, out/NAME_profile.png.")
    ] = None,
) -> None:
    """List climates, configurations and solvers; explain a solver; print optical depths, scale heights and refraction
    of one climate and draw its profile."""
    if what not in options.SHOWN:
        if name is not None:
            raise TwilightError(f"show {what}: takes one name, and {name} is a second; solvers and schema take one")
        _describe(what, settings, output)
        return
    if scene is not None and what != "solvers":
        raise TwilightError(f"show {what}: takes no scene ({scene}); show solvers NAME takes one")
    if (settings and scene is None) or output is not None:
        raise TwilightError(f"show {what}: --set and --output are for one climate or configuration")
    if what in ("climates", "configs"):
        if name is not None:
            raise TwilightError(f"show {what}: lists all of them and takes no name; twilight show {name} shows one")
        (_climates if what == "climates" else _configs)()
    elif what == "solvers":
        _solvers(name, scene, settings)
    else:
        _schema(name or "configuration")


def _climates() -> None:
    """The climates that come with twilight, with their aerosol optical depth at 550 nm."""
    from twilight.config import load_climate
    from twilight.config.load import shipped
    from twilight.scene.medium import climate_medium

    rows = []
    for name, path in shipped("climates").items():
        climate = load_climate(path)
        medium = climate_medium(climate, _wavelengths(550.0))
        rows.append([name, f"{medium.optical_depth('aerosol')[0]:.3f}", climate.description])
    print_table(["climate", "AOD 550 nm", "description"], rows, right=(1,))


def _configs() -> None:
    """The configurations that come with twilight."""
    from twilight.config import load_series
    from twilight.config.load import shipped
    from twilight.scene.suns import count_suns

    rows = []
    for name, path in shipped("configs").items():
        cases = load_series(path)
        rows.append([name, str(sum(count_suns(c.config) for c in cases)), cases[0].config.description])
    print_table(["configuration", "frames", "description"], rows, right=(1,))


def _solvers(name: str | None, target: str | None, given: list[str] | None) -> None:
    """The solvers, their qualities and first options with the values at quality `standard`; or all options of one, and
    its tuned numbers: all, or those that act in the air of a scene."""
    from dataclasses import asdict

    from twilight.base.sections import option_fields, unknown
    from twilight.config.solver import option_names
    from twilight.solvers import DEFAULT, SOLVERS, load

    if name is None:
        rows = []
        for one in SOLVERS:
            qualities = load(one).QUALITIES
            title = f"{one} (default)" if one == DEFAULT else one
            rows.append([title, "quality", ", ".join(qualities)])
            values = asdict(qualities["standard"])
            rows += [[one, key, str(values[key])] for key in option_names(qualities["standard"])[0]]
        print_table(["solver", "option", "value"], rows)
        print("solver.OPTION sets an option; `twilight show solvers NAME` explains one solver's, those for experts too")
        return
    if name not in SOLVERS:
        raise TwilightError(f"show solvers: {name} {unknown(name, SOLVERS, 'solver')}")
    tuned = getattr(load(name), "tuned_numbers", None)
    if tuned is None and target is not None:
        raise TwilightError(f"show solvers {name} {target}: {name} has no tuned numbers; zones has them")
    kinds = None if target is None else _kinds_met(name, target, given)
    qualities = load(name).QUALITIES
    presets = {quality: asdict(settings) for quality, settings in qualities.items()}
    why = option_fields(qualities["standard"])
    for title, keys in zip(("option", "solver.expert"), option_names(qualities["standard"]), strict=True):
        rows = [
            [key, *(_as_text(preset[key]) for preset in presets.values()), why[key].description or ""] for key in keys
        ]
        if rows:
            print_table([title, *presets, "what it is"], rows, right=tuple(range(1, 1 + len(presets))))
    if tuned is not None:
        acting = [row for row in tuned() if kinds is None or row.air in kinds]
        columns = ["tuned number", "value", "unit", "for air", "test", "what it does"]
        print_table(columns, [[row.name, str(row.value), *row[2:]] for row in acting], right=(1,))


def _kinds_met(name: str, target: str, given: list[str] | None) -> set[str]:
    """The kinds of air that a scene's is, to a solver at `standard`."""
    from twilight.config.load import load as configuration
    from twilight.scene import resolve
    from twilight.solvers import load

    solver: Any = load(name)
    made = resolve(configuration(target, options.settings_of(given)[0]), solver=(solver, solver.QUALITIES["standard"]))
    medium = made.medium if made.bands is None else made.bands.expand(made.medium)
    return solver.kinds_met(medium, made.settings)


def _as_text(value: Any) -> str:
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def _schema(document: str) -> None:
    """The JSON schema of climates or configurations, for editors."""
    from twilight.config import Climate, Config

    models: dict[str, Any] = {"climate": Climate, "configuration": Config, "config": Config}
    if document not in models:
        raise TwilightError(f"show schema: {document} must be climate or configuration")
    print(json.dumps(models[document].model_json_schema(), indent=2))


def _describe(target: str, settings: list[str] | None, output: Path | None) -> None:
    """Optical depths, scale heights and refraction of a climate, or of a configuration's; its profile as a picture."""
    from twilight.api.representation import profile_figure
    from twilight.base.whole_files import check_file
    from twilight.config import Config, load_climate
    from twilight.scene.medium import climate_medium
    from twilight.scene.plan import facts, optical_depths
    from twilight.scene.usual import described, usual_horizon, with_usual_ozone

    model = load_climate(target, *options.settings_of(settings))
    path = output or Path("out") / f"{model.name}_profile.png"
    options.check_suffix(path, "--output", ".png")
    check_file(path)
    shown, ozone_source = with_usual_ozone(model)
    medium = climate_medium(shown, None if model.medium is not None else _wavelengths(*DESCRIBED_NM))
    if ozone_source is not None:
        medium = replace(medium, notes={**medium.notes, "ozone_source": ozone_source})
    wavelength_nm = medium.wavelength_nm
    if model.description:
        print(f"{model.name}: {model.description}")
    rows = [[name, *(f"{tau:.4f}" for tau in depth)] for name, depth in optical_depths(medium)]
    columns = ["vertical optical depth", *(f"{w:g} nm" for w in wavelength_nm)]
    print_table(columns, rows, right=tuple(range(1, len(columns))))
    sources = {} if model.air is None else model.air.sources
    named = [[name if name == "not used" else f"source of {name}", text] for name, text in sources.items()]
    beyond = described(usual_horizon(Config(version=1, climate=model)))
    known = [*facts(medium), ("beyond the horizon, unless a scene says", beyond)]
    print_table(["property", "value"], [*(list(row) for row in known), *named])
    reference = int(abs(wavelength_nm - 550.0).argmin())
    parts = {
        "air": medium.air_scattering_per_km,
        "gases": medium.absorption_per_km,
        "aerosol": medium.aerosol_extinction_per_km,
    }
    lines = {name: part[:, reference] for name, part in parts.items() if part.any()}
    path.parent.mkdir(parents=True, exist_ok=True)
    profile_figure(model.name, medium.altitude_km, lines, wavelength_nm[reference], path)
    print(f"wrote {path}")


def _wavelengths(*wavelength_nm: float) -> Any:
    import numpy as np

    return np.array(wavelength_nm)
