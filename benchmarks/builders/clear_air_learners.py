"""What `clear_air_fit.py` fits by: a Gaussian process, and networks fitted to coefficients and to light; by PyTorch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twilight.clear_air.model import NODES, SUN_DEG, Model

DEPTH = 3
"""Hidden layers."""
FINE_EPOCHS = 60
"""Passes in each fit of light."""
BATCH = 128
"""Samples of a step."""
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
    them (N, 10); the first four of airs that are not solved, as the former model says; places (B,) of samples that are
    solved once more, better, and what that added to ln M (B, P)."""

    inputs: np.ndarray
    log_base: np.ndarray
    ratio: np.ndarray
    polarised: np.ndarray
    part: np.ndarray
    number: np.ndarray
    limits: np.ndarray
    limits_of: np.ndarray
    told: tuple[np.ndarray, ...]
    better: np.ndarray
    added: np.ndarray


def process(inputs: np.ndarray, target: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The mean of a Gaussian process through targets (N, K), as a function of inputs (M, F): Matern's kernel 5/2 with a
    length for each input, and a linear one, both by marginal likelihood of the leading components."""
    import torch

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


class Network:
    """One network, in training: called with inputs (N, F), it gives coefficients (N, K)."""

    def __init__(self, seed: int, width: int, count: int, scale: np.ndarray, model: Model):
        import torch

        torch.manual_seed(seed)
        self.torch, self.model, self.scale = torch, model, torch.tensor(scale)
        sizes = [count, *[width] * DEPTH]
        self.hidden = torch.nn.ModuleList(torch.nn.Linear(i, o) for i, o in pairwise(sizes))
        self.last = torch.nn.Linear(width, scale.size)
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
