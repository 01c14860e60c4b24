"""The named phenomena of twilight, measured on computed skies: python benchmarks/phenomena.py writes phenomena.csv.

Column `seen`: whether the phenomenon is there by a criterion on the number; airs and variants without its cause are in
the table too.  It also draws docs/phenomena.png: colours of the antisolar and the solar meridian through a sunset, the
Earth's shadow and the Belt of Venus over the sun's depression, zenith chromaticity with and without ozone, the purple
light, and the horizon after sunset.  One argument: the quality of zones, draft without it.
"""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import results
import sky_phenomena as see

from twilight.base.whole_files import save_figure
from twilight.config import load
from twilight.sky import colour

QUALITY = sys.argv[1] if len(sys.argv) > 1 else "draft"


@cache
def air(climate: str, **settings) -> see.Air:
    base = {"wavelengths.list_nm": list(see.WAVELENGTHS_NM), "solver.quality": QUALITY}
    return see.Air(load(climate, base | {key.replace("__", "."): value for key, value in settings.items()}))


def pair(x: float, y: float) -> str:
    return f"{x:.3f} {y:.3f}"


def blue_zenith():
    """Hulburt 1953 (J. Opt. Soc. Am. 43, 113); Adams, Plass and Kattawar 1974 (J. Atmos. Sci. 31, 1662)."""
    says = "without ozone grey to straw-coloured; Chappuis absorption makes it blue (Hulburt 1953)"
    for climate in ("pure-air", "continental-clean"):
        for name, settings in (("with ozone", {}), ("without ozone", {"gases__ozone__treatment": "none"})):
            a = air(climate, **settings)
            x, y = (float(v[0]) for v in see.chromaticity(a.xyz(-5.0, [90.0], [0.0])))
            ratio = see.red_over_blue(a, -5.0, 90.0, 0.0)
            seen = x < 0.28 and y < 0.30
            yield ("blue zenith", climate, name, -5.0, "x y", pair(x, y), says, seen)
            yield ("blue zenith", climate, name, -5.0, "L(670)/L(450) over the sun's", f"{ratio:.3f}", says, seen)


def belt_of_venus():
    """Lee 2015 (Appl. Opt. 54, B194)."""
    says = "reddish band above a bluish-grey shadow in clear civil twilight, most vivid in modest haze (Lee 2015)"
    for climate in ("pure-air", "continental-clean", "continental-average"):
        for sun in (-1.0, -2.0, -3.0, -4.0, -5.0):
            belt = see.belt_of_venus(air(climate), sun)
            if belt is None:
                yield ("Belt of Venus", climate, "", sun, "reddest band [deg]", "none", says, False)
                continue
            more = belt.x - max(belt.shadow_x, belt.sky_x)
            text = f"{belt.elevation_deg:.1f}: x {belt.x:.3f}, shadow {belt.shadow_x:.3f} at "
            text += f"{belt.shadow_elevation_deg:.1f}, sky above {belt.sky_x:.3f}"
            yield ("Belt of Venus", climate, "", sun, "reddest band [deg]", text, says, more > 0.004)


def earths_shadow():
    """Lynch, Dearborn and Lock 2017, Antitwilight I (Appl. Opt. 56, G156); Minnaert 1954."""
    says = "rises as the sun sinks, at first as fast as the sun, then 2 to 3 times as fast, lost by -6 (Minnaert 1954)"
    for climate in ("pure-air", "continental-clean"):
        edges = []
        for sun in (-1.0, -2.0, -3.0, -4.0, -5.0, -6.0):
            edge = see.shadow_edge_deg(air(climate), sun)
            edges.append(edge)
            rising = edge is not None and (len(edges) < 2 or (edges[-2] is not None and edge > edges[-2]))
            text = "none" if edge is None else f"{edge:.1f}"
            yield ("Earth's shadow", climate, "", sun, "elevation of its edge [deg]", text, says, rising)


def purple_light():
    """Lee and Hernandez-Andres 2003 (Appl. Opt. 42, 445)."""
    says = "vivid purple 20 deg up at -4 after eruptions; background aerosol alone does not redden enough (Lee 2003)"
    plain = air("continental-clean", stratosphere__kind="background")
    kinds = ("background", "moderate_volcanic", "high_volcanic", "extreme_volcanic")
    above = {}
    (x0,), (y0,) = see.chromaticity(plain.xyz(-4.0, [20.0], [0.0]))
    for kind in kinds:
        a = air("continental-clean", stratosphere__kind=kind)
        (x,), (y,) = see.chromaticity(a.xyz(-4.0, [20.0], [0.0]))
        above[kind] = see.above_daylight(x, y)
        text = f"{pair(x, y)}, {above[kind]:+.3f} above the daylight locus, {x - x0:+.3f} {y - y0:+.3f} from background"
        seen = "reference" if kind == "background" else above[kind] < above["background"] - 0.005
        yield ("purple light", "continental-clean", kind, -4.0, "x y", text, says, seen)
        ratio = see.red_over_blue(a, -4.0, 20.0, 0.0)
        measure = "L(670)/L(450) over the sun's"
        yield ("purple light", "continental-clean", kind, -4.0, measure, f"{ratio:.2f}", says, seen)


def stripes():
    """Haber, Magnor and Seidel 2005 sec. 1 (after Gruner and Kleinert 1927)."""
    says = "horizontal stripes a few minutes after sunset, maritime air (Haber 2005 sec. 1)"
    for climate in ("maritime-clean", "maritime-tropical", "maritime-polluted", "continental-average", "pure-air"):
        bands = see.horizon_bands(air(climate), -0.5)
        text = f"{bands.colour_steps:.0f} steps, at most {bands.steps_per_degree_at_most:.0f} in a degree "
        text += f"(at {bands.fastest_elevation_deg:.1f}); "
        text += "luminance maxima at " + (", ".join(f"{e:.1f}" for e in bands.luminance_maxima) or "none")
        seen = bands.steps_per_degree_at_most > 10
        yield ("horizontal stripes", climate, "", -0.5, "colour over the lowest 8 deg", text, says, seen)


def glow():
    """Haber, Magnor and Seidel 2005 sec. 1."""
    says = "a warm glow on the horizon 40 to 45 minutes after sunset (Haber 2005 sec. 1)"
    for climate in ("continental-average", "continental-clean", "pure-air", "volcanic-stratosphere"):
        for sun in (-4.0, -6.0, -8.0):
            g = see.afterglow(air(climate), sun)
            text = f"x {g.horizon_x:.3f} at 3 deg, warm to {g.height_deg:.0f} deg, {g.over_zenith:.0f} times the zenith"
            yield ("afterglow", climate, "", sun, "glow over the sun", text, says, g.horizon_x > 0.36)


def strip(a: see.Air, suns: np.ndarray, azimuth: float, elevation: np.ndarray) -> np.ndarray:
    """Colours of a meridian (elevation, sun, 3), each sun exposed for itself."""
    columns = []
    for sun in suns:
        rgb = colour.xyz_to_linear_rgb(a.xyz(float(sun), elevation, np.full(elevation.size, azimuth)))
        level = np.exp(np.log(np.maximum(rgb @ colour.REC709_LUMINANCE, 1e-30)).mean())
        columns.append(colour.tone_map(rgb, np.log2(level / (1.5 * colour.GREY_LUMINANCE_AT_EV100_0)), "filmic"))
    return np.stack(columns, axis=1)


def draw() -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 8), layout="constrained")
    axes = figure.subplots(2, 3)
    suns = np.arange(1.0, -8.01, -0.5)
    elevation = np.arange(0.25, 40.0, 0.5)
    clean = air("continental-clean")
    for axis, azimuth, title in ((axes[0, 0], 180.0, "antisolar meridian"), (axes[0, 1], 0.0, "solar meridian")):
        axis.imshow(
            strip(clean, suns, azimuth, elevation)[::-1], aspect="auto", extent=(suns[0], suns[-1], 0, elevation[-1])
        )
        axis.set(title=f"{title}, continental-clean", xlabel="sun [deg]", ylabel="elevation [deg]")
    depression = np.arange(0.5, 6.01, 0.5)
    for climate in ("pure-air", "continental-clean"):
        edge = [see.shadow_edge_deg(air(climate), -d) for d in depression]
        belt = [see.belt_of_venus(air(climate), -d) for d in depression]
        edge_deg = [np.nan if e is None else e for e in edge]
        belt_deg = [np.nan if b is None else b.elevation_deg for b in belt]
        (line,) = axes[0, 2].plot(depression, edge_deg, label=f"shadow's edge, {climate}")
        axes[0, 2].plot(depression, belt_deg, "o", color=line.get_color(), label=f"Belt of Venus, {climate}")
    axes[0, 2].plot(depression, depression, "k:", label="antisolar point")
    axes[0, 2].set(xlabel="depression of the sun [deg]", ylabel="elevation [deg]", title="the Earth's shadow")
    axes[0, 2].legend(fontsize=8)

    locus_x = np.linspace(0.23, 0.40, 50)
    for axis, title in (
        (axes[1, 0], "zenith, sun 5 to -9 deg"),
        (axes[1, 1], "20 deg up in the solar azimuth, sun 0 to -6"),
    ):
        axis.plot(locus_x, -3 * locus_x**2 + 2.87 * locus_x - 0.275, "k:", label="daylight locus")
        axis.set(xlabel="x", ylabel="y", title=title)
    for name, settings in (("ozone", {}), ("no ozone", {"gases__ozone__treatment": "none"})):
        a = air("continental-clean", **settings)
        x, y = np.transpose([np.ravel(see.chromaticity(a.xyz(s, [90.0], [0.0]))) for s in np.arange(5.0, -9.1, -1.0)])
        axes[1, 0].plot(x, y, ".-", label=name)
        axes[1, 0].plot(x[10], y[10], "k*", ms=10, label="sun at -5" if name == "ozone" else None)
    for kind in ("background", "moderate_volcanic", "high_volcanic", "extreme_volcanic"):
        a = air("continental-clean", stratosphere__kind=kind)
        x, y = np.transpose([np.ravel(see.chromaticity(a.xyz(s, [20.0], [0.0]))) for s in np.arange(0.0, -6.1, -1.0)])
        axes[1, 1].plot(x, y, ".-", label=kind.replace("_", " "))
        axes[1, 1].plot(x[4], y[4], "k*", ms=10, label="sun at -4" if kind == "background" else None)
    for climate in ("maritime-clean", "maritime-tropical", "continental-average"):
        p = air(climate).profile(-0.5, 0.0, np.arange(0.1, 10.0, 0.2))
        axes[1, 2].plot(p.x, p.elevation_deg, label=climate)
    axes[1, 2].set(xlabel="x", ylabel="elevation [deg]", title="horizon under the sun at -0.5 deg")
    for axis in axes[1]:
        axis.legend(fontsize=8)
        axis.grid(alpha=0.3)
    save_figure(results.ROOT / "docs" / "phenomena.png", figure, 110)


def main() -> None:
    rows = []
    for part in (blue_zenith, belt_of_venus, earths_shadow, purple_light, stripes, glow):
        for row in part():
            rows.append(
                [*row[:3], f"{row[3]:g}", *row[4:7], row[7] if isinstance(row[7], str) else "yes" if row[7] else "no"]
            )
            print(*rows[-1][:6], rows[-1][7], sep="\t", flush=True)
    results.write(
        results.FOLDER / "phenomena.csv",
        ["phenomenon", "climate", "variant", "sun_elevation_deg", "measure", "value", "literature", "seen"],
        rows,
    )
    draw()


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
