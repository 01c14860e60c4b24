"""`twilight eclipse`: the moon in the shadow of the Earth, and a satellite that enters it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import print_table

if TYPE_CHECKING:
    from twilight.studies.eclipse.shadow import Shadow

WAVELENGTHS_NM = (400.0, 440.0, 480.0, 520.0, 560.0, 600.0, 640.0, 680.0)
"""Outside the bands of water vapour and oxygen."""
SATELLITE_KM = (200.0, 400_000.0)


def eclipse(
    climate: Annotated[list[str], argument("CLIMATE...", "Names or files.", options.climate_names)],
    date: Annotated[str | None, option("DATE", "Of an eclipse of the moon, e.g. 2018-07-27.")] = None,
    satellite_altitude_km: Annotated[
        float | None, option("KM", "In place of a date: sunlight on a satellite that enters the shadow.")
    ] = None,
    cloud_top_km: Annotated[float | None, option("KM", "Clouds all along the limb, which let nothing through.")] = None,
    settings: Annotated[
        list[str] | None, option("KEY=VALUE", "Any key of the climates; may be repeated.", "--set")
    ] = None,
    output: Annotated[Path | None, option("DIR", "Folder; without it, out/eclipse-DATE or out/shadow-KM.")] = None,
) -> None:
    """The shadow of the Earth: its light and colour, the light curve of an eclipse of the moon, a satellite's sunlight.

    Sunlight is refracted, spread and dimmed by the air around the Earth's limb, the same everywhere along it; for the
    moon light that this air scatters forwards, once, is added.
    """
    import numpy as np

    from twilight.base.whole_files import check_folder
    from twilight.config import load_climate
    from twilight.scene.medium import climate_medium
    from twilight.studies.eclipse.shadow import Shadow

    if (date is None) == (satellite_altitude_km is None):
        raise TwilightError("eclipse: takes either --date or --satellite-altitude-km")
    chosen, _ = options.settings_of(settings)
    nm = np.array(WAVELENGTHS_NM)
    if satellite_altitude_km is not None:
        options.check_range(satellite_altitude_km, "--satellite-altitude-km", *SATELLITE_KM)
        folder = output or Path("out") / f"shadow-{satellite_altitude_km:g}-km"
    else:
        day = options.parse_date(str(date), "--date", "2018-07-27")
        folder = output or Path("out") / f"eclipse-{day.isoformat()}"
    check_folder(folder)
    shadows = {}
    for one in climate:
        found = load_climate(one, chosen)
        shadows[found.name] = Shadow(climate_medium(found, nm), cloud_top_km)
    if satellite_altitude_km is not None:
        _satellite(shadows, satellite_altitude_km, nm, folder)
        return

    from twilight.studies.eclipse import danjon, report
    from twilight.studies.eclipse.circumstances import find_eclipse
    from twilight.studies.eclipse.light import magnitudes, shadow_light, visual

    event = find_eclipse(day)
    lights = {name: shadow_light(shadow, event) for name, shadow in shadows.items()}
    folder.mkdir(parents=True, exist_ok=True)
    files = report.write(lights, event, nm, folder)
    print_table(["contact", "time (UTC)"], [[name, f"{t:%Y-%m-%d %H:%M:%S}"] for name, t in event.contacts.items()])
    print(f"umbral magnitude {event.umbral_magnitude:.3f}")
    middle = int(np.argmin(event.moon.offset_rad))
    offset, total = event.moon.offset_rad[middle], "U2" in event.contacts
    rows = []
    for name, light in lights.items():
        magnitude = float(magnitudes(light, event.moon)[middle])
        there = float(light.visual_at(np.array([offset]))[0])
        scattered = float(np.interp(offset, light.offset_rad, visual(light.scattered, nm)))
        row = [name, f"{there:.2e}", f"{100.0 * scattered / there:.1f}", f"{magnitude:.2f}"]
        if total:
            number = danjon.danjon_number(danjon.luminance(magnitude, light.distance_km))
            row.append(f"{number:.1f}, {danjon.description(number)}")
        rows.append(row)
    columns = ["climate", "light at the moon's centre", "of it scattered [%]", "magnitude at greatest eclipse"]
    print_table(columns + ["Danjon's number, estimated"] * total, rows, right=(1, 2, 3))
    print(f"wrote {', '.join(files)} to {folder}/")


def _satellite(shadows: dict[str, Shadow], altitude_km: float, nm, folder: Path) -> None:
    """satellite.csv: sunlight against time about the edge of the shadow."""
    import numpy as np

    from twilight.base.whole_files import write_csv
    from twilight.studies.eclipse.light import satellite, visual

    seconds = np.arange(-30.0, 60.5, 1.0)
    rows, printed = [], []
    for name, shadow in shadows.items():
        offset, light = satellite(shadow, altitude_km, seconds)
        seen = visual(light, nm)
        for s, o, v, e in zip(seconds, offset, seen, light, strict=True):
            rows.append([name, f"{s:g}", f"{o:.4f}", f"{v:.5g}", *(f"{x:.5g}" for x in e)])
        for s in (-10.0, 0.0, 10.0, 20.0, 30.0):
            printed.append([name, f"{s:+g}", f"{seen[int(np.flatnonzero(seconds == s)[0])]:.3e}"])
    folder.mkdir(parents=True, exist_ok=True)
    columns = ["climate", "seconds", "offset_deg", "visual", *(f"irradiance_{w:g}_nm" for w in nm)]
    write_csv(folder / "satellite.csv", columns, rows, "irradiance at normal incidence over that above the shadow")
    print_table(["climate", "seconds after the edge", "illuminance over the sun's"], printed, right=(1, 2))
    print(f"wrote satellite.csv to {folder}/")
