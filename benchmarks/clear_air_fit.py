"""Fit the model of all clear air to airs that `clear_air_airs.py` drew and solved.

    python benchmarks/clear_air_fit.py AIRS APPROXIMATE [FILE.npz]       folders of clear_air_airs.py; AIRS may be a
                                                                         file of clear_air_kept.py

Needs PyTorch, takes a quarter of an hour and holds one file of airs in ten out: it prints the errors in these, and
calibrates the model's estimate of its error on them.

A Gaussian process on the airs, networks fitted to them, and the former model, fitted to others, err differently: their
mean is nearer than any.  It teaches the networks of the file, by airs that are not solved, what lies between.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from clear_air_airs import SETTINGS, SIDE_BY_SIDE, UNSOLVED
from clear_air_kept import components, solved

from twilight import __version__
from twilight.base.whole_files import whole_file
from twilight.solvers.compact.field import SHIPPED
from twilight.transport.clear_air.model import FORMAT, NODES, SUN_DEG, Model, outputs

HELD_OUT = 10
"""One file in so many judges the fit."""
COMPONENTS = {"intensity": 128, "polarisation": 64, "base": 48}
"""Principal components of ln(M / M_0), of Q / M and U / M, and of ln M_0 under all suns."""
MEMBERS = 3
"""Networks whose mean counts; their spread gives the error of a sky."""
WIDTH = 256
"""Units of a hidden layer."""
DEPTH = 3
"""Hidden layers."""
EPOCHS = 300
"""Passes over the samples in the fit of coefficients to solved airs."""
TAUGHT_EPOCHS = 60
"""Passes in the fit of coefficients to the teacher's answers too."""
FINE_EPOCHS = 60
"""Passes in each fit of light."""
BATCH = 128
"""Samples of a step."""
RATE = 2e-3
"""Largest step of AdamW in the fit of coefficients to solved airs."""
TAUGHT_RATE = 1e-3
"""Largest step with the teacher's answers."""
FINE_RATE = 3e-4
"""Largest step in the fit of light."""
DECAY = 0.1
"""Weight decay of AdamW."""
TOLERATED = np.interp(SUN_DEG, [-18.0, -12.0, -6.0, 0.0], [0.05, 0.03, 0.015, 0.01])
"""Errors of radiance that weigh the same under each sun."""
TOLERATED_POLARISATION = 0.01
"""Error of Q / I and U / I that weighs as much."""
LEAST_PART = 0.1
"""Fraction of all light that light scattered more than once counts as at least."""
LEAST_LEFT = 0.2
"""Part of M that is left at least when its degree changes."""
COVERED = 0.95
"""Fraction of the skies whose error is at most the one that the model estimates."""
SINGLE_ERROR = np.interp(SUN_DEG, [-7.0, -4.0, -1.0, 3.0], [0.0, 0.004, 0.008, 0.003])
"""Error of light scattered once, of all light, about: it is computed, not fitted."""
MIXED = 60000
"""Airs between two others, at random, that the teacher answers too: means of their inputs."""
FORMER_SHARE = 0.25
"""Share of the former model in the teacher's answer where both say the same."""
FORMER_APART = 0.1
"""Distance of their ln M, at 95 % of the nodes, at which that share is half as much."""
LENGTHS_OF = 700
"""Samples of a step in the fit of the process's lengths."""
LENGTH_STEPS = 60
"""Steps of Adam in it."""
LENGTH_RATE = 0.05
"""Largest step of ln(length)."""
LEADING = 40
"""Components that it looks at."""


@dataclass
class Data:
    """Samples, one for each air, observer and wavelength: inputs (N, F'), ln M_0 (N, B), ln(M / M_0) (N, P), Q / M and
    U / M (N, 2 P), part of M in all light (N, P), number of the file (N,); what limits the airs (10, 2) and each of
    them (N, 10); the first four of airs that are not solved, as the former model says."""

    inputs: np.ndarray
    log_base: np.ndarray
    ratio: np.ndarray
    polarised: np.ndarray
    part: np.ndarray
    number: np.ndarray
    limits: np.ndarray
    limits_of: np.ndarray
    told: tuple[np.ndarray, ...]


def read(airs: Path, approximate: Path, held_out_alone: bool = False) -> Data:
    """The samples of all airs that are solved, or of those that are held out, and what the model computes of them;
    airs: a folder or a kept file."""
    keys = ("inputs", "log_base", "ratio", "polarised")
    rows: dict[str, list[np.ndarray]] = {key: [] for key in (*keys, "part", "number")}
    told: dict[str, list[np.ndarray]] = {key: [] for key in keys}
    limits = []
    for number, multiple, polarised in solved(airs):
        if held_out_alone and (number % HELD_OUT or number >= UNSOLVED):
            continue
        name = approximate / f"{number:05d}.npz"
        if not name.exists():
            sys.exit(f"{name}: missing; see --approximate in clear_air_airs.py")
        some = rows if number < UNSOLVED else told
        with np.load(name) as computed:
            base = _samples(np.moveaxis(computed["base"], -1, 1))
            some["inputs"].append(_samples(computed["inputs"]))
            some["log_base"].append(_samples(computed["log_base"]))
            if number < UNSOLVED:
                single = _samples(np.moveaxis(computed["single"], -1, 1))
                multiple, polarised = _at_own_degree(multiple, polarised, computed["moved"])
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
    """What every network is fitted to: a model without networks, which samples train, inputs of all, coefficients of
    those that train over their scale, inputs of airs that are not solved, and what the process says of these; of the
    first of these what the former model says."""

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
    return finished(data, lesson, [member(data, lesson, seed) for seed in range(MEMBERS)])


def prepared(data: Data) -> Lesson:
    """The lesson of samples; prints the errors of the process."""
    import torch

    torch.set_num_threads(2)
    torch.set_default_device("cuda" if torch.cuda.is_available() else "cpu")
    train = data.number % HELD_OUT != 0
    model = _without_networks(data, train)
    coefficients = _coefficients(model, data.ratio[train], data.polarised[train])
    k = COMPONENTS["intensity"]
    scale = np.concatenate(
        [np.full(part.shape[1], part.std(), np.float32) for part in (coefficients[:, :k], coefficients[:, k:])]
    )
    target = (coefficients / scale).astype(np.float32)
    inputs = model.standardised(data.inputs, data.log_base)
    others, former = model.standardised(*data.told[:2]), _coefficients(model, *data.told[2:])
    unsolved = np.concatenate([others, _between(np.concatenate([inputs[train], others]))])
    processes = [_process(torch, inputs[train], target[:, some]) for some in (slice(0, k), slice(k, None))]
    held, by_process = (
        np.concatenate([one(x) for one in processes], axis=1) * scale for x in (inputs[~train], unsolved)
    )
    print(f"process, held out:\n{_errors(model, data, ~train, held)}", flush=True)
    return Lesson(model, train, inputs, target, scale, unsolved, by_process, former)


def member(data: Data, lesson: Lesson, seed: int) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """The layers of one network; prints its errors."""
    import torch

    torch.set_default_device("cuda" if torch.cuda.is_available() else "cpu")
    model, train, inputs = lesson.model, lesson.train, lesson.inputs
    network = _Network(torch, seed, inputs.shape[1], lesson.scale, model)
    network.fit_coefficients(inputs[train], lesson.target, EPOCHS, RATE)
    network.fit_light(data, train, inputs, None)
    print(f"network {seed}, held out:\n{_errors(model, data, ~train, network(inputs[~train]))}", flush=True)
    taught, told = 0.5 * (lesson.by_process + network(lesson.unsolved)), len(lesson.former)
    apart = (lesson.former - taught[:told])[:, : COMPONENTS["intensity"]] @ model.intensity[:, ::7]
    apart = np.percentile(np.abs(apart), 95, axis=1, keepdims=True)
    share = FORMER_SHARE / (1.0 + (apart / FORMER_APART) ** 2)
    taught[:told] += share * (lesson.former - taught[:told])
    taught = taught.astype(np.float32)
    both = np.concatenate([inputs[train], lesson.unsolved]), np.concatenate([lesson.target, taught / lesson.scale])
    network.fit_coefficients(*both, TAUGHT_EPOCHS, TAUGHT_RATE)
    network.fit_light(data, train, inputs, (lesson.unsolved, taught))
    print(f"taught, held out:\n{_errors(model, data, ~train, network(inputs[~train]))}", flush=True)
    return network.layers()


def finished(data: Data, lesson: Lesson, members: list[tuple[tuple[np.ndarray, np.ndarray], ...]]) -> Model:
    """The model of networks, with the estimate of its error; prints its errors."""
    held = ~lesson.train
    model = replace(lesson.model, members=tuple(members))
    print(f"all, held out:\n{_errors(model, data, held)}", flush=True)
    settings = ("degree", "max_degree", "altitude_density", "zenith_density")
    return replace(
        model,
        error=_calibrated(model, data, held),
        provenance={
            "version": __version__,
            "airs": int((data.number < SIDE_BY_SIDE).sum() // 16 + (data.number >= SIDE_BY_SIDE).sum() // 2),
            "solver": "zones",
            "held_out_percent": [round(100.0 * float(x), 3) for x in of_median_sky(off(model, data, held)[0])],
            "settings": {key: getattr(SETTINGS, key) for key in settings},
        },
    )


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


def _process(torch: Any, inputs: np.ndarray, target: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The mean of a Gaussian process through targets (N, K), as a function of inputs (M, F): Matern's kernel 5/2 with a
    length for each input, and a linear one, both by marginal likelihood of the leading components."""
    torch.manual_seed(0)
    x, y = (torch.tensor(values).double() for values in (inputs, target))
    n = x.shape[1]
    lengths = torch.full((n,), 0.5 * float(np.log(n)), dtype=torch.double, requires_grad=True)
    others = torch.tensor(np.log([0.02, 0.1]), requires_grad=True)  # variances of noise and of the linear kernel

    def kernel(a, b):
        a, b = (part * torch.exp(-lengths) for part in (a, b))
        square = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2.0 * a @ b.T
        d = torch.sqrt(5.0 * torch.clamp(square, min=1e-12))
        return (1.0 + d + d * d / 3.0) * torch.exp(-d) + torch.exp(others[1]) * (a @ b.T)

    def factor(a):
        return torch.linalg.cholesky(kernel(a, a) + torch.exp(others[0]) * torch.eye(len(a), dtype=torch.double))

    optimiser = torch.optim.Adam([lengths, others], lr=LENGTH_RATE)
    share = (y[:, :LEADING] ** 2).mean(0)
    share = share / share.sum()
    for _ in range(LENGTH_STEPS):
        some = torch.randperm(len(x))[:LENGTHS_OF]
        lower, values = factor(x[some]), y[some][:, :LEADING]
        fitted = (values * torch.cholesky_solve(values, lower)).sum(0) / len(some)
        loss = 0.5 * len(some) * (share * torch.log(fitted)).sum() + torch.log(torch.diagonal(lower)).sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        weights = torch.cholesky_solve(y, factor(x))

    def mean(at: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            rows = [kernel(part, x) @ weights for part in torch.split(torch.tensor(at).double(), 2048)]
            return torch.cat(rows).cpu().numpy().astype(np.float32)

    return mean


class _Network:
    """One network, in training: called with inputs (N, F), it gives coefficients (N, K)."""

    def __init__(self, torch: Any, seed: int, count: int, scale: np.ndarray, model: Model):
        torch.manual_seed(seed)
        self.torch, self.model, self.scale = torch, model, torch.tensor(scale)
        sizes = [count, *[WIDTH] * DEPTH]
        self.hidden = torch.nn.ModuleList(torch.nn.Linear(i, o) for i, o in pairwise(sizes))
        self.last = torch.nn.Linear(WIDTH, scale.size)
        with torch.no_grad():
            self.last.weight.zero_()
            self.last.bias.zero_()

    def _forward(self, x):
        for n, layer in enumerate(self.hidden):
            active = self.torch.nn.functional.silu(layer(x))
            x = active + x if n else active
        return self.last(x)

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        with self.torch.no_grad():
            return (self._forward(self.torch.tensor(inputs)) * self.scale).cpu().numpy()

    def _epochs(self, samples: int, epochs: int, rate: float, loss_of) -> None:
        torch, parameters = self.torch, [*self.hidden.parameters(), *self.last.parameters()]
        optimiser = torch.optim.AdamW(parameters, lr=rate, weight_decay=DECAY)
        steps = epochs * -(-samples // BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=steps, pct_start=0.1)
        for _ in range(epochs):
            for some in torch.split(torch.randperm(samples), BATCH):
                loss = loss_of(some)
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                schedule.step()

    def fit_coefficients(self, inputs: np.ndarray, target: np.ndarray, epochs: int, rate: float) -> None:
        """Fit to coefficients over their scale."""
        x, t = self.torch.tensor(inputs), self.torch.tensor(target)
        self._epochs(len(x), epochs, rate, lambda some: ((self._forward(x[some]) - t[some]) ** 2).mean())

    def fit_light(self, data: Data, train: np.ndarray, inputs: np.ndarray, taught) -> None:
        """Fit to the light of the airs, and to coefficients that a teacher gives for other inputs."""
        torch, model, k = self.torch, self.model, self.model.intensity.shape[0]
        x = torch.tensor(inputs[train])
        intensity, polarisation = torch.tensor(model.intensity), torch.tensor(model.polarisation)
        ratio = torch.tensor(data.ratio[train] - model.intensity_mean)
        polarised = torch.tensor(data.polarised[train] - model.polarisation_mean)
        part = torch.tensor(data.part[train])
        tolerated = torch.tensor(np.repeat(TOLERATED.astype(np.float32), NODES[1] * NODES[2]))
        others = None if taught is None else tuple(torch.tensor(one) for one in taught)
        usual = part.float().mean(0)

        def distance(off, parts, nodes, turned):
            off = off * torch.clamp(parts, min=LEAST_PART) / tolerated[nodes]
            turned = turned * torch.cat([parts] * 2, dim=-1) / TOLERATED_POLARISATION
            # errors beyond three tolerated ones count by their size, not its square: a few airs are no rule for all
            losses = (torch.nn.functional.huber_loss(one, 0.0 * one, delta=3.0) for one in (off, turned))
            return sum(losses)

        def of_light(some):
            nodes = torch.randperm(ratio.shape[1])[: ratio.shape[1] // 6]
            both = torch.cat([nodes, nodes + ratio.shape[1]])
            seen, crossed = intensity[:, nodes], polarisation[:, both]
            c = self._forward(x[some]) * self.scale
            off, turned = c[:, :k] @ seen - ratio[some][:, nodes], c[:, k:] @ crossed - polarised[some][:, both]
            loss = distance(off, part[some][:, nodes].float(), nodes, turned)
            if others is not None:
                few = torch.randint(len(others[0]), (BATCH,))
                c = self._forward(others[0][few]) * self.scale - others[1][few]
                loss = loss + distance(c[:, :k] @ seen, usual[nodes].expand(len(c), -1), nodes, c[:, k:] @ crossed)
            return loss

        self._epochs(len(x), FINE_EPOCHS, FINE_RATE, of_light)

    def layers(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """What `Model.members` holds of it."""
        layers = [[part.detach().cpu().numpy() for part in (one.weight, one.bias)] for one in (*self.hidden, self.last)]
        *hidden, (weight, bias) = layers
        scale = self.scale.cpu().numpy()
        return *((w.T.copy(), b.copy()) for w, b in hidden), (weight.T * scale, bias * scale)


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


def main(words: Sequence[str]) -> None:
    match words:
        case [airs, approximate, *output] if len(output) < 2:
            path = Path(output[0]) if output else SHIPPED
            save(fit(read(Path(airs), Path(approximate))), path)
            print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB)")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
