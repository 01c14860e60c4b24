"""Fit the model of all clear air, and measure its errors.

    python benchmarks/clear_air.py fit AIRS APPROXIMATE [FILE.npz]            with the folders of clear_air_airs.py
    python benchmarks/clear_air.py climates                              writes clear_air.csv
    python benchmarks/clear_air.py calibrate                             the error that it estimates, by clear_air.csv
    python benchmarks/clear_air.py screen                                writes clear_air_screen.csv
    python benchmarks/clear_air.py picture                               draws ../docs/clear-air.png

`fit` needs PyTorch, takes half an hour and holds one air in ten out: it prints the errors in these, and calibrates the
model's estimate of its error on them.
`climates` compares it with the Monte-Carlo reference solution of thirteen climates (`zones_error.py`), `screen` what
`horizon: typical` takes of ln(light) with what it takes by `zones`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import results
from clear_air_airs import SETTINGS, drawn
from zones_error import CLIMATES
from zones_error import errors as zones_errors

import twilight
from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.sky import colour
from twilight.solvers.compact.air import air_of, limited
from twilight.solvers.compact.field import SHIPPED, ClearAirField, load_model
from twilight.transport.clear_air import FORMAT, NODES, SUN_DEG, Model

HELD_OUT = 10
"""One air in so many judges the fit."""
COMPONENTS = {"intensity": 128, "polarisation": 64, "base": 48}
"""Principal components of ln(M / M_0), of Q / M and U / M, and of ln M_0 under all suns."""
MEMBERS = 3
"""Networks whose mean counts; their spread gives the error of a sky."""
WIDTH = 256
"""Units of a hidden layer."""
DEPTH = 3
"""Hidden layers."""
EPOCHS = 400
"""Passes over the samples in the fit of coefficients."""
FINE_EPOCHS = 100
"""Passes in the fit of light that follows."""
BATCH = 128
"""Samples of a step."""
RATE = 2e-3
"""Largest step of AdamW in the fit of coefficients."""
FINE_RATE = 3e-4
"""Largest step in the fit of light."""
DECAY = 0.1
"""Weight decay of AdamW."""
TOLERATED = np.interp(SUN_DEG, [-18.0, -12.0, -6.0, 0.0], [0.05, 0.03, 0.015, 0.01])
"""Errors of radiance that weigh the same under each sun."""
TOLERATED_POLARISATION = 0.01
"""Error of Q / I and U / I that weighs as much."""
REFERENCE_COVERED = 0.97
"""Fraction of the reference skies that `calibrate` covers, so that COVERED hold in climates that it has not seen."""
LEAST_PART = 0.1
"""Fraction of all light that light scattered more than once counts as at least."""
COVERED = 0.95
"""Fraction of the skies whose error is at most the one that the model estimates."""
SINGLE_ERROR = np.interp(SUN_DEG, [-7.0, -4.0, -1.0, 3.0], [0.0, 0.004, 0.008, 0.003])
"""Error of light scattered once, of all light, about: it is computed, not fitted."""
DARKEST = 1e-32
"""Least M over F0 that is fitted [sr^-1]."""
COLUMNS = (
    *("climate", "sun_elevation_deg", "median_percent", "p95_percent", "max_percent", "reference_percent"),
    *("excess_percent", "estimated_percent", "p95_degree_of_polarisation"),
)
PICTURED = (("urban", 10.0), ("desert", 1.0), ("continental-average", -4.0), ("maritime-tropical", -9.0))
"""Climates and suns of the picture."""
PICTURED_NM = np.linspace(385.0, 735.0, 8)


@dataclass
class Data:
    """Samples, one for each air, observer and wavelength: inputs (N, F'), ln M_0 (N, B), ln(M / M_0) (N, P), Q / M and
    U / M (N, 2 P), part of M in all light (N, P), number of the air (N,), what limits the airs."""

    inputs: np.ndarray
    log_base: np.ndarray
    ratio: np.ndarray
    polarised: np.ndarray
    part: np.ndarray
    number: np.ndarray
    limits: np.ndarray


SCREENED = ("continental-clean", "continental-average", "urban")
SCREENED_SUNS_DEG = (3.2, 0.4, -0.6, -1.4, -2.4, -3.6, -4.6, -6.4, -8.4, -11.4, -15.6)


def _weight_of_suns() -> np.ndarray:
    """By how much ln M counts at each node (P,): errors that weigh the same are `TOLERATED`."""
    return np.repeat((TOLERATED.min() / TOLERATED).astype(np.float32), NODES[1] * NODES[2])


def read(airs: Path, approximate: Path) -> Data:
    """The samples of all airs that both folders have: solved ones, and what the model computes of them."""
    rows: dict[str, list[np.ndarray]] = {
        key: [] for key in ("inputs", "log_base", "ratio", "polarised", "part", "number")
    }
    limits = []
    for path in sorted(airs.glob("*.npz")):
        name, number = approximate / path.name, int(path.stem)
        if not name.exists():
            continue
        with np.load(path) as solved:
            best = solved["standard" if "standard" in solved else "light"]
        light = np.moveaxis(best, (-1, -2), (1, 2)).astype(float)  # observers W Stokes suns E A
        with np.load(name) as computed:
            base, single = (np.moveaxis(computed[key], -1, 1).astype(float) for key in ("base", "single"))
            count = base.shape[0] * base.shape[1]
            multiple = np.maximum(light[:, :, 0], DARKEST)
            rows["ratio"].append(np.log(multiple / base).reshape(count, -1).astype(np.float32))
            rows["part"].append((multiple / (multiple + single)).reshape(count, -1).astype(np.float16))
            stokes = np.clip(light[:, :, 1:] / multiple[:, :, None], -1.0, 1.0)
            rows["polarised"].append(stokes.reshape(count, -1).astype(np.float32))
            rows["inputs"].append(computed["inputs"].reshape(count, -1))
            rows["log_base"].append(computed["log_base"].reshape(count, -1))
            rows["number"].append(np.full(count, number))
            limits.append(limited(air_of(drawn(number)[0])))
    every = np.concatenate(limits, axis=1)
    outermost = np.stack([np.nanmin(every, axis=1), np.nanmax(every, axis=1)], axis=1)
    return Data(**{key: np.concatenate(value) for key, value in rows.items()}, limits=outermost)


def components(values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P,) and principal components (count, P) of values (N, P), from their largest covariances."""
    mean = values.mean(axis=0)
    rng = np.random.default_rng(0)
    start = rng.standard_normal((values.shape[1], count + 16)).astype(np.float32)
    centred = values - mean
    for _ in range(4):  # subspace iteration
        start, _ = np.linalg.qr(centred.T @ (centred @ start))
    _, _, turned = np.linalg.svd(centred @ start, full_matrices=False)
    return mean, (turned[:count] @ start.T).astype(np.float32)


def fit(data: Data) -> Model:
    """The model of samples."""
    import torch

    torch.set_num_threads(2)
    train = data.number % HELD_OUT != 0
    model, coefficients = _without_networks(data, train)
    parts = np.split(coefficients[train], [COMPONENTS["intensity"]], axis=1)
    scale = np.concatenate([np.full(part.shape[1], part.std(), np.float32) for part in parts])
    target = (coefficients / scale).astype(np.float32)
    standard = model.standardised(data.inputs, data.log_base)
    members = [_member(torch, seed, data, train, standard, target, scale, model) for seed in range(MEMBERS)]
    model = replace(model, members=tuple(members))
    print(f"held out:\n{_errors(model, data, ~train)}")
    return replace(
        model,
        error=_calibrated(model, data, ~train),
        provenance={
            "version": __version__,
            "airs": int(np.unique(data.number).size),
            "solver": "zones",
            "settings": {
                key: getattr(SETTINGS, key) for key in ("degree", "max_degree", "altitude_density", "zenith_density")
            },
        },
    )


def _without_networks(data: Data, train: np.ndarray) -> tuple[Model, np.ndarray]:
    """A model without networks, and the coefficients of its principal components that make the samples, (N, K)."""
    by_sun = _weight_of_suns()
    mean, vectors = components(data.ratio[train] * by_sun, COMPONENTS["intensity"])
    coefficients = (data.ratio * by_sun - mean) @ vectors.T
    intensity_mean, intensity = mean / by_sun, vectors / by_sun
    polarisation_mean, polarisation = components(data.polarised[train], COMPONENTS["polarisation"])
    of_polarisation = (data.polarised - polarisation_mean) @ polarisation.T
    base_mean, base_vectors = components(data.log_base[train], COMPONENTS["base"])
    inputs = np.concatenate([data.inputs, (data.log_base - base_mean) @ base_vectors.T], axis=1)
    model = Model(
        (),
        inputs[train].mean(axis=0),
        inputs[train].std(axis=0) + 1e-6,
        base_mean,
        base_vectors,
        intensity_mean,
        intensity,
        polarisation_mean,
        polarisation,
        data.limits,
        np.zeros((2, SUN_DEG.size)),
        {},
    )
    return model, np.concatenate([coefficients, of_polarisation], axis=1)


def _member(torch: Any, seed: int, data: Data, train, standard, target, scale, model: Model):
    """One network: coefficients first, then light."""
    torch.manual_seed(seed)
    sizes = [standard.shape[1], *[WIDTH] * DEPTH]
    hidden = torch.nn.ModuleList(torch.nn.Linear(i, o) for i, o in pairwise(sizes))
    last = torch.nn.Linear(WIDTH, scale.size)
    with torch.no_grad():
        last.weight.zero_()
        last.bias.zero_()
    parameters = [*hidden.parameters(), *last.parameters()]

    def network(x):
        for n, layer in enumerate(hidden):
            active = torch.nn.functional.silu(layer(x))
            x = active + x if n else active
        return last(x)

    x = torch.tensor(standard[train])
    steps = -(-len(x) // BATCH)

    def epochs(count: int, rate: float, loss_of) -> None:
        optimiser = torch.optim.AdamW(parameters, lr=rate, weight_decay=DECAY)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=count * steps, pct_start=0.1)
        for _ in range(count):
            order = torch.randperm(len(x))
            for first in range(0, len(x), BATCH):
                loss = loss_of(order[first : first + BATCH])
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                schedule.step()

    t = torch.tensor(target[train])
    epochs(EPOCHS, RATE, lambda some: ((network(x[some]) - t[some]) ** 2).mean())
    k = model.intensity.shape[0]
    intensity, polarisation = torch.tensor(model.intensity), torch.tensor(model.polarisation)
    ratio = torch.tensor(data.ratio[train] - model.intensity_mean)
    polarised = torch.tensor(data.polarised[train] - model.polarisation_mean)
    part = torch.tensor(data.part[train])
    tolerated = torch.tensor(np.repeat(TOLERATED.astype(np.float32), NODES[1] * NODES[2]))
    to_light = torch.tensor(scale)

    def of_light(some):
        nodes = torch.randperm(ratio.shape[1])[: ratio.shape[1] // 4]
        c = network(x[some]) * to_light
        weight = torch.clamp(part[some][:, nodes].float(), min=LEAST_PART) / tolerated[nodes]
        off = (c[:, :k] @ intensity[:, nodes] - ratio[some][:, nodes]) * weight
        both = torch.cat([nodes, nodes + ratio.shape[1]])
        turned = c[:, k:] @ polarisation[:, both] - polarised[some][:, both]
        turned = turned * torch.cat([part[some][:, nodes].float()] * 2, dim=1) / TOLERATED_POLARISATION
        # errors beyond three tolerated ones count by their size, not its square: a few airs are no rule for all
        return torch.nn.functional.huber_loss(off, torch.zeros_like(off), delta=3.0) + torch.nn.functional.huber_loss(
            turned, torch.zeros_like(turned), delta=3.0
        )

    epochs(FINE_EPOCHS, FINE_RATE, of_light)
    with torch.no_grad():
        last.weight *= to_light[:, None]
        last.bias *= to_light
    return tuple(
        (layer.weight.detach().numpy().T.copy(), layer.bias.detach().numpy().copy()) for layer in [*hidden, last]
    )


def _calibrated(model: Model, data: Data, some: np.ndarray) -> np.ndarray:
    """`Model.error`, by which COVERED of the skies are at least as near as estimated, (2, suns)."""
    ratio, _, _, spread = model.at_nodes(data.inputs[some], data.log_base[some])
    part = data.part[some].astype(np.float32).reshape(-1, *NODES)
    off = np.abs(ratio - data.ratio[some].reshape(-1, *NODES)) * part
    sky_off, sky_spread = (np.percentile(one, 95, axis=(2, 3)) for one in (off, spread * part))
    times = sky_off / np.maximum(sky_spread, 1e-9)
    near = [slice(max(0, n - 1), n + 2) for n in range(SUN_DEG.size)]
    return np.stack([SINGLE_ERROR, [np.quantile(times[:, suns], COVERED) for suns in near]])


def _errors(model: Model, data: Data, some: np.ndarray) -> str:
    """Errors of all light at 95 % of the nodes, by sun [per cent]."""
    got = model.at_nodes(data.inputs[some], data.log_base[some])[:3]
    off = (got[0].reshape(some.sum(), -1) - data.ratio[some]) * data.part[some].astype(np.float32)
    percent = 100.0 * np.percentile(np.abs(off.reshape(-1, *NODES)), [50, 95], axis=(0, 2, 3))
    turned = np.concatenate([g.reshape(some.sum(), -1) for g in got[1:]], axis=1) - data.polarised[some]
    turned *= np.tile(data.part[some].astype(np.float32), 2)
    polarised = np.percentile(np.abs(turned.reshape(-1, 2, *NODES)), 95, axis=(0, 1, 3, 4))
    return "\n".join(
        f"{sun:6.1f} deg: median {m:.2f} %, 95 % {p:.2f} %; Q, U over I {q:.4f}"
        for sun, m, p, q in zip(SUN_DEG, *percent, polarised, strict=True)
    )


def save(model: Model, path: Path) -> None:
    """Write the file that `twilight.transport.clear_air` describes: components and weights as half floats."""
    keys = [key for key in Model.__dataclass_fields__ if key not in ("members", "provenance")]
    arrays: dict[str, Any] = {key: getattr(model, key).astype(np.float32) for key in keys}
    for key in ("intensity", "polarisation"):
        scale = np.abs(arrays[key]).max(axis=1)
        arrays[f"{key}_scale"] = scale
        arrays[key] = (arrays[key] / scale[:, None]).astype(np.float16)
    arrays["base_vectors"] = arrays["base_vectors"].astype(np.float16)
    arrays["layers"] = np.array([[w.shape[0] for w, _ in m] + [m[-1][0].shape[1]] for m in model.members])
    weights = [a.ravel() for m in model.members for layer in m for a in layer]
    arrays["weights"] = np.concatenate(weights).astype(np.float16)
    with whole_file(path) as unfinished, open(unfinished, "wb") as file:
        np.savez_compressed(file, format=FORMAT, provenance=json.dumps(model.provenance), **arrays)


def calibrate(path: Path) -> None:
    """Multiply the error that a model estimates, so that REFERENCE_COVERED of the skies of `clear_air.csv` are at least
    as near as it says; `climates` comes first.  Prints how many hold in climates that were left out."""
    table = results.read_rows(results.FOLDER / "clear_air.csv")
    ratio = np.array([float(row["excess_percent"]) / float(row["estimated_percent"]) for row in table])
    names = np.array([row["climate"] for row in table])
    held = [ratio[names == name] <= np.quantile(ratio[names != name], REFERENCE_COVERED) for name in set(names)]
    factor = float(np.quantile(ratio, REFERENCE_COVERED))
    print(f"times {factor:.3f}; holds in {100 * np.mean(ratio <= factor):.1f} % of the skies, left out")
    print(
        f"{100 * np.concatenate(held).mean():.1f} %; estimated over true in the median {factor / np.median(ratio):.2f}"
    )
    model = load_model(path)
    save(replace(model, error=model.error * factor), path)


def climates(model: Model) -> None:
    """Compare the model with the reference solutions of climates, and write the table."""
    rows = []
    for name, table_name in CLIMATES.items():
        table = results.read_numbers(results.FOLDER / "reference" / f"{table_name}.csv")
        medium = climate_medium(load_climate(name), np.unique(table["wavelength_nm"]))
        try:
            field = ClearAirField(medium, model, medium.bottom_km, polarisation=True)
        except TwilightError as refused:
            print(name, refused)
            continue
        for sun, median, most, largest, _, own, excess in zones_errors(field, table):
            some = table[table["sun_elevation_deg"] == sun]
            place = np.arange(some.size), slice(None), np.searchsorted(medium.wavelength_nm, some["wavelength_nm"])
            light = field.stokes(sun, some["elevation_deg"], some["azimuth_deg"])[place[0], :, place[2]]
            estimated = 100.0 * field.convergence.error
            degree = np.hypot(light[:, 1], light[:, 2]) / light[:, 0]
            right = np.hypot(some["q_per_sr"], some["u_per_sr"]) / some["radiance_per_sr"]
            off = np.percentile(np.abs(degree - right), 95)
            percent = (f"{value:.2f}" for value in (median, most, largest, own, excess, estimated))
            rows.append([name, f"{sun:g}", *percent, f"{off:.4f}"])
            print(*rows[-1], sep="\t", flush=True)
    results.write(results.FOLDER / "clear_air.csv", COLUMNS, rows)
    for sun in dict.fromkeys(row[1] for row in rows):
        excess, estimated = ([float(row[k]) for row in rows if row[1] == sun] for k in (6, 7))
        print(
            f"sun {sun}: excess {np.median(excess):.2f} (median climate), {max(excess):.2f} (largest); estimated",
            estimated,
        )


def screen() -> None:
    """What the screen `typical` takes by zones and by compact, at 95 % of the directions, and the difference; suns lie
    between the model's."""
    nm, rows = (450.0, 550.0, 680.0), []
    e, a = np.meshgrid([0.5, 2, 4, 7, 11, 16, 22, 30, 40, 55, 75, 90], np.arange(0.0, 181.0, 12.0), indexing="ij")
    for name in SCREENED:
        taken: dict[tuple[str, float], np.ndarray] = {}
        for solver in ("zones", "compact"):
            clean, dimmed = (
                twilight.solve(name, solver=solver, wavelength_nm=nm, settings={"horizon": horizon})
                for horizon in ("clean", "typical")
            )
            for sun in SCREENED_SUNS_DEG:
                taken[solver, sun] = np.log(clean.radiance(sun, e, a) / dimmed.radiance(sun, e, a)).reshape(-1, len(nm))
        for sun in SCREENED_SUNS_DEG:
            exact = taken["zones", sun]
            of_directions = (np.abs(part) for part in (exact, taken["compact", sun] - exact))
            most, off = (np.percentile(part, 95, axis=0) for part in of_directions)
            rows += [
                [name, f"{sun:g}", f"{w:g}", f"{m:.3f}", f"{d:.3f}"] for w, m, d in zip(nm, most, off, strict=True)
            ]
            print(*rows[-1], sep="\t", flush=True)
    columns = ("climate", "sun_elevation_deg", "wavelength_nm", "taken_p95", "difference_p95")
    results.write(results.FOLDER / "clear_air_screen.csv", columns, rows)


def picture(path: Path) -> None:
    """The model, zones and the ratio of their luminances, half a sky each: azimuth 0 to 180 deg to the right."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    e, a = np.meshgrid(np.arange(1.0, 90.0, 2.0), np.arange(0.0, 180.1, 2.0), indexing="ij")
    figure, axes = pyplot.subplots(len(PICTURED), 3, figsize=(12, 2.2 * len(PICTURED)), layout="constrained")
    for (climate, sun), line in zip(PICTURED, axes, strict=True):
        fields = [
            twilight.solve(climate, wavelength_nm=PICTURED_NM, sun_elevation_deg=[sun], **how)
            for how in ({"solver": "compact"}, {"quality": "standard"})
        ]
        near, true = (np.asarray(field.radiance(sun, e, a)) for field in fields)
        titles = [f"{name}: {climate}, sun {sun:g}°" for name in ("compact", "zones")]
        titles.append(f"luminance [%]; spectral 95 % {100 * np.percentile(np.abs(near / true - 1), 95):.1f}")
        draw_beside(figure, line, (near, true), PICTURED_NM, e, titles, 5.0)
    figure.savefig(path, dpi=80)


def draw_beside(
    figure: Any,
    axes: Sequence[Any],
    skies: tuple[np.ndarray, np.ndarray],
    wavelength_nm: np.ndarray,
    elevation_deg: np.ndarray,
    titles: Sequence[str],
    largest_percent: float,
) -> None:
    """Two skies (E, A, W), half a sky each, at the exposure of the second, and the difference of their luminances."""
    xyz = [colour.spectrum_to_xyz(sky, wavelength_nm) for sky in skies]
    ev = colour.auto_exposure_ev100(xyz[1][..., 1], np.cos(np.radians(elevation_deg)))
    half_sky: dict[str, Any] = {"origin": "lower", "extent": (0, 180, 0, 90), "aspect": "auto"}
    for axis, values in zip(axes, xyz, strict=False):
        axis.imshow(colour.tone_map(colour.xyz_to_linear_rgb(values), ev), **half_sky)
    percent = 100.0 * (xyz[0][..., 1] / xyz[1][..., 1] - 1.0)
    image = axes[2].imshow(percent, cmap="RdBu_r", vmin=-largest_percent, vmax=largest_percent, **half_sky)
    figure.colorbar(image, ax=axes[2])
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=9)


def main(words: Sequence[str]) -> None:
    match words:
        case ["fit", airs, approximate, *output]:
            path = Path(output[0]) if output else SHIPPED
            save(fit(read(Path(airs), Path(approximate))), path)
            print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB)")
        case ["climates"]:
            climates(load_model(SHIPPED))
        case ["calibrate"]:
            calibrate(SHIPPED)
        case ["screen"]:
            screen()
        case ["picture"]:
            picture(results.ROOT / "docs" / "clear-air.png")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
