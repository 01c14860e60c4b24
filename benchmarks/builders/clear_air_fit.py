"""Fit the model of all clear air to airs that `clear_air_airs.py` drew and solved.

    python benchmarks/builders/clear_air_fit.py AIRS APPROXIMATE [FILE.npz]   folders of clear_air_airs.py;
                                                                AIRS may be a file of clear_air_kept.py
    python benchmarks/builders/clear_air_fit.py sizes AIRS APPROXIMATE        writes clear_air_sizes.csv

Needs PyTorch, takes a quarter of an hour and holds one file of airs in ten out: it prints the errors in these, and
calibrates the model's estimate of its error on them.  `sizes` fits networks of other widths too.

A Gaussian process on the airs, networks fitted to them, and the former model, fitted to others, err differently: their
mean is nearer than any.  It teaches the networks of the file, by airs that are not solved, what lies between.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results
from clear_air_airs import BETTER, SETTINGS, SIDE_BY_SIDE, UNSOLVED
from clear_air_kept import components, degrees, solved
from clear_air_learners import TOLERATED, Data, Network, process

from twilight import __version__
from twilight.base.whole_files import whole_file
from twilight.clear_air.entry import SHIPPED, load_model
from twilight.clear_air.model import FORMAT, NODES, SUN_DEG, Model, outputs

HELD_OUT = 10
"""One file in so many judges the fit."""
COMPONENTS = {"intensity": 128, "polarisation": 64, "base": 48}
"""Principal components of ln(M / M_0), of Q / M and U / M, and of ln M_0 under all suns."""
MEMBERS = 3
"""Networks whose mean counts; their spread gives the error of a sky."""
WIDTH = 256
"""Units of a hidden layer."""
WIDTHS = (64, 128, 512)
"""Others, of which `sizes` fits one network each."""
PARTS = (0.25, 0.5, 0.75)
"""Parts of the components that it looks at."""
JUDGED_SUNS = (1, 4, 7, 10, 12, 16, 19, 20, 22, 25)
"""Places in SUN_DEG of the tables of errors."""
EPOCHS = 300
"""Passes over the samples in the fit of coefficients to solved airs."""
TAUGHT_EPOCHS = 60
"""Passes in the fit of coefficients to the teacher's answers too."""
RATE = 2e-3
"""Largest step of AdamW in the fit of coefficients to solved airs."""
TAUGHT_RATE = 1e-3
"""Largest step with the teacher's answers."""
COVERED = 0.95
"""Fraction of the skies whose error is at most the one that the model estimates."""
LEAST_LEFT = 0.2
"""Part of M that is left at least when its degree changes."""
SINGLE_ERROR = np.interp(SUN_DEG, [-7.0, -4.0, -1.0, 3.0], [0.0, 0.004, 0.008, 0.003])
"""Error of light scattered once, of all light, about: it is computed, not fitted."""
MIXED = 60000
"""Airs between two others, at random, that the teacher answers too: means of their inputs."""
FORMER_SHARE = 0.25
"""Share of the former model in the teacher's answer where both say the same."""
FORMER_APART = 0.1
"""Distance of their ln M, at 95 % of the nodes, at which that share is half as much."""


def read(airs: Path, approximate: Path, held_out_alone: bool = False) -> Data:
    """The samples of all airs that are solved, or of those that are held out, and what the model computes of them;
    airs: a folder or a kept file."""
    keys = ("inputs", "log_base", "ratio", "polarised")
    rows: dict[str, list[np.ndarray]] = {key: [] for key in (*keys, "part", "number")}
    told: dict[str, list[np.ndarray]] = {key: [] for key in keys}
    limits, degree = [], degrees(airs)
    once: dict[int, tuple[int, np.ndarray]] = {}  # of a file that is solved once more, its place, and M at first
    better, added = [np.zeros(0, int)], [np.zeros((0, np.prod(NODES)), np.float32)]
    for number, multiple, polarised in solved(airs):
        if held_out_alone and (number % HELD_OUT or UNSOLVED <= number < BETTER):
            continue
        name = approximate / f"{number:05d}.npz"
        if not name.exists():
            sys.exit(f"{name}: missing; see --approximate in clear_air_airs.py")
        with np.load(name) as computed:
            if not np.isclose(computed["degree"], degree[number]):
                sys.exit(f"{name}: of another solution; see --approximate in clear_air_airs.py")
            if not UNSOLVED <= number < BETTER:
                multiple, polarised = _at_own_degree(multiple, polarised, computed["moved"])
            if number >= BETTER:
                place, before = once[number - BETTER]
                added.append(np.log(multiple / before).astype(np.float32))
                better.append(sum(map(len, rows["number"][:place])) + np.arange(len(multiple)))
                rows["ratio"][place] += added[-1]
                rows["polarised"][place] = polarised.astype(np.float32)
                continue
            base, some = _samples(np.moveaxis(computed["base"], -1, 1)), rows if number < UNSOLVED else told
            some["inputs"].append(_samples(computed["inputs"]))
            some["log_base"].append(_samples(computed["log_base"]))
            if number < UNSOLVED:
                single = _samples(np.moveaxis(computed["single"], -1, 1))
                if number + BETTER in degree:
                    once[number] = len(rows["number"]), multiple
                limits.append(computed["limits"])
                rows["part"].append((multiple / (multiple + single)).astype(np.float16))
                rows["number"].append(np.full(len(multiple), number))
        some["ratio"].append(np.log(multiple / base).astype(np.float32))
        some["polarised"].append(polarised.astype(np.float32))
    if not (told["inputs"] or held_out_alone):
        sys.exit(f"{airs}: no airs from {UNSOLVED} on; see --first in clear_air_airs.py")
    every = np.concatenate([np.tile(one, 2) for one in limits], axis=1)  # of both observers
    outermost = np.stack([np.nanmin(every, axis=1), np.nanmax(every, axis=1)], axis=1)
    return Data(
        **{key: np.concatenate(value) for key, value in rows.items()},
        limits=outermost,
        limits_of=every.T,
        told=() if held_out_alone else tuple(np.concatenate(value) for value in told.values()),
        better=np.concatenate(better),
        added=np.concatenate(added),
    )


def _at_own_degree(multiple: np.ndarray, polarised: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M (N, P) and Q / M, U / M (N, 2 P) of a solution whose phase functions were followed to a degree, for that which
    the model follows them to: all light is the same in both.  moved: `clear_air_airs.moved`, less its own, (observers,
    suns, E, A, 3, W)"""
    more = np.moveaxis(moved, (-1, -2), (1, 2)).reshape(len(multiple), 3, -1)
    own = np.maximum(multiple + more[:, 0], LEAST_LEFT * multiple)
    stokes = polarised.reshape(more[:, 1:].shape) * multiple[:, None] + more[:, 1:]
    return own, np.clip(stokes / own[:, None], -1.0, 1.0).reshape(len(multiple), -1)


def _samples(values: np.ndarray) -> np.ndarray:
    """Values (observers, W, ...) as rows (N, ...)."""
    return values.reshape(values.shape[0] * values.shape[1], -1)


class Lesson(NamedTuple):
    """What every network is fitted to: the samples, a model without networks, which samples train, inputs of all,
    coefficients of those that train over their scale, inputs of airs that are not solved, and what the process says of
    these; of the first of these what the former model says."""

    data: Data
    model: Model
    train: np.ndarray
    inputs: np.ndarray
    target: np.ndarray
    scale: np.ndarray
    unsolved: np.ndarray
    by_process: np.ndarray
    former: np.ndarray


def fit(data: Data) -> Model:
    """The model of samples."""
    lesson = prepared(data)
    return finished(lesson, [member(lesson, seed) for seed in range(MEMBERS)])


def prepared(data: Data) -> Lesson:
    """The lesson of samples; prints the errors of the process."""
    import torch

    torch.set_num_threads(2)
    torch.set_default_device("cuda" if torch.cuda.is_available() else "cpu")
    train = data.number % HELD_OUT != 0
    model = _without_networks(data, train)
    coefficients = _coefficients(model, data.ratio[train], data.polarised[train])
    k = model.intensity.shape[0]
    scale = np.concatenate(
        [np.full(part.shape[1], part.std(), np.float32) for part in (coefficients[:, :k], coefficients[:, k:])]
    )
    target = (coefficients / scale).astype(np.float32)
    inputs = model.standardised(data.inputs, data.log_base)
    others, former = model.standardised(*data.told[:2]), _coefficients(model, *data.told[2:])
    unsolved = np.concatenate([others, _between(np.concatenate([inputs[train], others]))])
    processes = [process(inputs[train], target[:, some]) for some in (slice(0, k), slice(k, None))]
    held, by_process = (
        np.concatenate([one(x) for one in processes], axis=1) * scale for x in (inputs[~train], unsolved)
    )
    print(f"process, held out:\n{_errors(model, data, ~train, held)}", flush=True)
    return Lesson(data, model, train, inputs, target, scale, unsolved, by_process, former)


def member(lesson: Lesson, seed: int, width: int = WIDTH) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """The layers of one network; prints its errors."""
    import torch

    torch.set_default_device("cuda" if torch.cuda.is_available() else "cpu")
    data, model, train, inputs = lesson.data, lesson.model, lesson.train, lesson.inputs
    network = Network(seed, width, inputs.shape[1], lesson.scale, model)
    network.fit_coefficients(inputs[train], lesson.target, EPOCHS, RATE)
    network.fit_light(data, train, inputs, None)
    taught, told = 0.5 * (lesson.by_process + network(lesson.unsolved)), len(lesson.former)
    apart = (lesson.former - taught[:told])[:, : model.intensity.shape[0]] @ model.intensity[:, ::7]
    apart = np.percentile(np.abs(apart), 95, axis=1, keepdims=True)
    share = FORMER_SHARE / (1.0 + (apart / FORMER_APART) ** 2)
    taught[:told] += share * (lesson.former - taught[:told])
    taught = taught.astype(np.float32)
    both = np.concatenate([inputs[train], lesson.unsolved]), np.concatenate([lesson.target, taught / lesson.scale])
    network.fit_coefficients(*both, TAUGHT_EPOCHS, TAUGHT_RATE)
    network.fit_light(data, train, inputs, (lesson.unsolved, taught))
    held = _errors(model, data, ~train, network(inputs[~train]))
    print(f"network {seed}, {width} wide, held out:\n{held}", flush=True)
    return network.layers()


def finished(lesson: Lesson, members: list[tuple[tuple[np.ndarray, np.ndarray], ...]]) -> Model:
    """The model of networks, with the estimate of its error; prints its errors."""
    data, held = lesson.data, ~lesson.train
    model = replace(lesson.model, members=tuple(members))
    print(f"all, held out:\n{_errors(model, data, held)}", flush=True)
    settings = ("degree", "max_degree", "altitude_density", "zenith_density")
    return replace(
        model,
        error=_calibrated(model, data, held),
        provenance={
            "version": __version__,
            "airs": _airs(data.number),
            "solver": "zones",
            "airs_solved_better": _airs(data.number[data.better]),
            "held_out_percent": [round(100.0 * float(x), 3) for x in of_median_sky(off(model, data, held)[0])],
            "settings": {key: getattr(SETTINGS, key) for key in settings},
        },
    )


def _airs(number: np.ndarray) -> int:
    """How many airs samples of files are of."""
    return int((number < SIDE_BY_SIDE).sum() // 16 + (number >= SIDE_BY_SIDE).sum() // 2)


def sizes(lesson: Lesson) -> None:
    """Errors and sizes of the shipped model with fewer networks and fewer components, and of one network of other
    widths, and write the table."""
    held, rows, shipped = ~lesson.train, [], load_model(SHIPPED)
    models = [replace(shipped, members=shipped.members[: n + 1]) for n in range(MEMBERS)]
    models += [_with_fewer(shipped, part) for part in PARTS]
    models += [replace(lesson.model, members=(member(lesson, 0, width),)) for width in WIDTHS]
    for model in models:
        with tempfile.TemporaryDirectory() as folder:
            save(model, path := Path(folder) / "model.npz")
            size = path.stat().st_size / 1e6
        percent = 100.0 * of_median_sky(off(model, lesson.data, held)[0])
        of = len(model.members), model.members[0][0][0].shape[1], model.intensity.shape[0]
        rows.append([*of, f"{size:.2f}", *(f"{percent[s]:.2f}" for s in JUDGED_SUNS)])
        print(*rows[-1], sep="\t", flush=True)
    columns = (f"median_p95_percent_at_{SUN_DEG[s]:g}" for s in JUDGED_SUNS)
    results.write(
        results.FOLDER / "clear_air_sizes.csv", ("networks", "width", "components", "megabytes", *columns), rows
    )


def _with_fewer(model: Model, part: float) -> Model:
    """A model with the first part of its components."""
    k, some = model.intensity.shape[0], round(part * model.intensity.shape[0])
    others = round(part * model.polarisation.shape[0])
    kept = np.r_[:some, k : k + others]
    members = tuple((*layers, (w[:, kept], b[kept])) for *layers, (w, b) in model.members)
    return replace(model, members=members, intensity=model.intensity[:some], polarisation=model.polarisation[:others])


def _between(inputs: np.ndarray) -> np.ndarray:
    """MIXED inputs (MIXED, F), each on the way from one of these (N, F) to another."""
    rng = np.random.default_rng(0)
    one, other = inputs[rng.integers(len(inputs), size=(2, MIXED))]
    part = rng.random((MIXED, 1), np.float32)
    return part * one + (1.0 - part) * other


def _weight_of_suns() -> np.ndarray:
    """By how much ln M counts at each node (P,): errors that weigh the same are `TOLERATED`."""
    return np.repeat((TOLERATED.min() / TOLERATED).astype(np.float32), NODES[1] * NODES[2])


def _coefficients(model: Model, ratio: np.ndarray, polarised: np.ndarray) -> np.ndarray:
    """Coefficients (N, K) of the principal components that make ln(M / M_0) (N, P), and Q / M, U / M (N, 2 P)."""
    by_sun = _weight_of_suns()
    intensity = ((ratio - model.intensity_mean) * by_sun) @ (model.intensity * by_sun).T
    return np.concatenate([intensity, (polarised - model.polarisation_mean) @ model.polarisation.T], axis=1)


def _without_networks(data: Data, train: np.ndarray) -> Model:
    """A model without networks."""
    by_sun = _weight_of_suns()
    mean, vectors = components(data.ratio[train] * by_sun, COMPONENTS["intensity"])
    polarisation_mean, polarisation = components(data.polarised[train], COMPONENTS["polarisation"])
    base_mean, base_vectors = components(data.log_base[train], COMPONENTS["base"])
    inputs = np.concatenate([data.inputs, (data.log_base - base_mean) @ base_vectors.T], axis=1)[train]
    return Model(
        (),
        *(inputs.mean(axis=0), inputs.std(axis=0) + 1e-6),
        *(base_mean, base_vectors),
        *(mean / by_sun, vectors / by_sun),
        *(polarisation_mean, polarisation),
        data.limits,
        np.zeros((2, SUN_DEG.size)),
        {},
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


def off(model: Model, data: Data, some: np.ndarray, coefficients: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
    """By how much all light (N, S, E, A), over itself, and Q and U over I (N, 2, S, E, A), are off in some samples."""
    if coefficients is None:
        inputs = model.standardised(data.inputs[some], data.log_base[some])
        coefficients = np.mean([outputs(layers, inputs) for layers in model.members], axis=0)
    k = model.intensity.shape[0]
    part = data.part[some].astype(np.float32)
    light = np.abs(model.intensity_mean + coefficients[:, :k] @ model.intensity - data.ratio[some]) * part
    turned = model.polarisation_mean + coefficients[:, k:] @ model.polarisation - data.polarised[some]
    return light.reshape(-1, *NODES), np.abs(turned * np.tile(part, 2)).reshape(-1, 2, *NODES)


def _errors(model: Model, data: Data, some: np.ndarray, coefficients: np.ndarray | None = None) -> str:
    """Errors of all light by sun [per cent]: at 95 % of all nodes, and at 95 % of those of the median sky."""
    light, turned = off(model, data, some, coefficients)
    columns = (
        100.0 * np.percentile(light, 95, axis=(0, 2, 3)),
        100.0 * of_median_sky(light),
        np.percentile(turned, 95, axis=(0, 1, 3, 4)),
    )
    return "\n".join(
        f"{sun:6.1f} deg: 95 % {most:.2f} %, of the median sky {sky:.2f} %; Q, U over I {q:.4f}"
        for sun, most, sky, q in list(zip(SUN_DEG, *columns, strict=True))[1::3]
    )


def of_median_sky(light: np.ndarray) -> np.ndarray:
    """Errors (N, S, E, A) at 95 % of the directions of the median sky, (S,)."""
    return np.median(np.percentile(light, 95, axis=(2, 3)), axis=0)


def save(model: Model, path: Path) -> None:
    """Write the file that `twilight.clear_air` describes: components and weights as half floats."""
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


def main(words: Sequence[str]) -> None:
    match words:
        case ["sizes", airs, approximate]:
            sizes(prepared(read(Path(airs), Path(approximate))))
        case [airs, approximate, *output] if len(output) < 2:
            path = Path(output[0]) if output else SHIPPED
            save(fit(read(Path(airs), Path(approximate))), path)
            print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB)")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
