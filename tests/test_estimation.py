"""The worked example of optimal estimation in docs/examples: errors are within the covariance that it states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

EXAMPLES = Path(__file__).resolve().parents[1] / "docs" / "examples"


@pytest.fixture
def example(monkeypatch):
    pytest.importorskip("pyOptimalEstimation")
    monkeypatch.syspath_prepend(EXAMPLES)
    import optimal_estimation

    return optimal_estimation


@pytest.mark.slow
@pytest.mark.parametrize("sought", ["ozone", "aerosol"])
def test_errors_are_within_their_covariance(example, sought):
    """Derivatives with a wrong sign, unit or layer would end without convergence, or far from the truth."""
    evening = example.Twilight(sought)
    slopes = evening.jacobian()
    noise = example.NOISE * np.random.default_rng(0).normal(size=len(evening.s_y))
    found = evening.retrieve(evening.forward(evening.true) + noise, slopes)
    error = found.x_op.to_numpy() - evening.true
    assert error @ np.linalg.solve(found.S_op.to_numpy(), error) < chi2.ppf(0.999, error.size)
    assert np.all(np.diag(found.S_op) < np.diag(evening.s_a))
    # what the light knows best: the highest node, through which the last sunlight comes
    assert abs(error[-1]) < 4.0 * found.x_op_err.iloc[-1] and found.dgf_x.iloc[-1] > 0.8
    values = evening.trials(100 if sought == "aerosol" else 10, slopes, found)
    low, high = chi2.ppf([0.0005, 0.9995], values.size * error.size)
    assert low < values.sum() < high
