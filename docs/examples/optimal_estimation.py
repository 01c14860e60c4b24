"""A profile of ozone, or of aerosol, from the zenith sky of one twilight, by optimal estimation (Rodgers 2000).

    python optimal_estimation.py ozone       or aerosol: a retrieval with a picture, and TRIALS linear about it

y is ln(radiance) of the zenith over suns, x the logarithm of ozone, or of aerosol extinction, over the prior's, at
NODES_KM and linear between them.  Here twilight computes y of the true air too.  Derivatives are those of
`field.jacobian` for the prior's air, in every step of the iteration, which is that of pyOptimalEstimation (pip install
pyOptimalEstimation; its licence is GPL).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pyOptimalEstimation import optimalEstimation
from scipy.linalg import block_diag
from scipy.stats import chi2

import twilight

SUNS_DEG = (4.0, 2.0, 0.0, -1.0, -2.0, -3.0, -4.0, -5.0)
WAVELENGTHS_NM = {"ozone": (325.0,), "aerosol": (780.0,)}  # in ozone's Huggins bands; beside all bands
NODES_KM = {"ozone": np.array([8.0, 14, 18, 22, 26, 32]), "aerosol": np.array([12.0, 18, 24])}
SPREAD = {"ozone": 0.2, "aerosol": 0.4}  # standard deviation of ln in the prior
RANGE_KM = 5.0  # over which it is correlated
TRIALS = 100
NOISE = 0.01  # standard deviation of every y
TRUE = {"ozone": np.array([0.1, 0.2, 0.2, 0.1, -0.1, -0.15]), "aerosol": np.array([0.2, 0.5, 0.2])}
BOXES_KM = np.array([0.0, 12, 16, 20, 24, 28, 34, 60])  # layers by which light is differentiated
EACH = {"ozone": "absorption", "aerosol": "aerosol_extinction"}
COARSE = {"altitude_density": 0.35, "zenith_density": 0.4, "polar_directions": 4, "beam_density": 0.4}
DRY = {"gases.water_vapour.column_mm": 0.0, "gases.oxygen": False}
Z = np.r_[0:50:1.0, 50:101:2.5]  # levels [km]
FINE = np.arange(0.1, 60.0, 0.2)  # points of integrals over boxes [km]


class Twilight:
    """What one evening's instrument sees, and what is sought."""

    def __init__(self, *sought):
        self.nm, self.sought = np.concatenate([WAVELENGTHS_NM[gas] for gas in sought]), sought
        self.true = np.concatenate([TRUE[gas] for gas in sought])
        air = twilight.medium("pure-air", self.nm, {**DRY, "gases.ozone.treatment": "none"})
        self.air, with_ozone = air.at(Z), twilight.medium("pure-air", self.nm, DRY).at(Z)
        layer = 1.5e-3 * np.exp(-(((Z - 19.0) / 6.0) ** 2))
        self.prior = {
            "ozone": with_ozone.absorption - self.air.absorption,
            "aerosol": layer[:, None] * (self.nm / 550.0) ** -1.6,
        }
        self.names = [f"{gas} {z:g} km" for gas in sought for z in NODES_KM[gas]]
        nodes = [(NODES_KM[gas], SPREAD[gas]) for gas in sought]
        self.s_a = block_diag(*[s**2 * np.exp(-np.abs(z[:, None] - z) / RANGE_KM) for z, s in nodes])
        self.s_y = NOISE**2 * np.eye(len(SUNS_DEG) * self.nm.size)
        self.zero = np.zeros(len(self.names))

    def profiles(self, x):
        """ln of each constituent over the prior's at its nodes."""
        ends = np.cumsum([NODES_KM[gas].size for gas in self.sought])
        return dict(zip(self.sought, np.split(np.asarray(x), ends[:-1]), strict=True))

    def field(self, x):
        """The solved field of a state."""
        parts = dict(self.prior)
        for gas, values in self.profiles(x).items():
            parts[gas] = parts[gas] * np.exp(np.interp(Z, NODES_KM[gas], values))[:, None]
        altitude, nm = (a.ravel() for a in np.meshgrid(Z, self.nm, indexing="ij"))
        table = {"altitude_km": altitude, "wavelength_nm": nm, "aerosol_single_scattering_albedo": 1.0,
                 "air_scattering_per_km": self.air.air_scattering.ravel(), "aerosol_asymmetry": 0.7,
                 "absorption_per_km": (self.air.absorption + parts["ozone"]).ravel(),
                 "aerosol_extinction_per_km": parts["aerosol"].ravel(),
                 "refractivity": self.air.refractivity.ravel()}  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "air.csv"
            pd.DataFrame(table).to_csv(path, index=False)
            climate = {"version": 1, "medium": {"table": str(path)}, "ground": {"albedo": 0.15}}
            settings = {f"solver.expert.{key}": value for key, value in COARSE.items()}
            return twilight.solve({"version": 1, "climate": climate}, wavelength_nm=self.nm, quality="draft",
                                  settings=settings, sun_elevation_deg=SUNS_DEG)  # fmt: skip

    def forward(self, x, **_):
        """F(x)."""
        field = self.field(x)
        return np.log([field.radiance(sun, 90.0, 0.0) for sun in SUNS_DEG]).ravel()

    def jacobian(self):
        """dF/dx of the prior's air: by optical depth of a box, times the depth that x brings there, over all boxes."""
        by = [EACH[gas] for gas in self.sought]
        slopes = self.field(self.zero).jacobian(SUNS_DEG, 90.0, 0.0, by=by, edges_km=BOXES_KM)
        found = []
        for gas in self.sought:
            dense = np.array([np.interp(FINE, Z, column) for column in self.prior[gas].T])
            for unit in np.eye(NODES_KM[gas].size):
                more = 0.2 * dense * np.interp(FINE, NODES_KM[gas], unit)
                depth = np.add.reduceat(more, np.searchsorted(FINE, BOXES_KM[:-1]), axis=1)
                found.append(np.einsum("sjw,wj->sw", slopes[EACH[gas]].values, depth).ravel())
        return np.array(found).T

    def retrieve(self, y, slopes, forward=None):
        """The estimate from a measurement; slopes: dF/dx; forward: in place of F."""
        numbers = [f"{sun:g} deg, {nm:g} nm" for sun in SUNS_DEG for nm in self.nm]
        found = optimalEstimation(self.names, self.zero, self.s_a, numbers, y, self.s_y, forward or self.forward,
                                  userJacobian=lambda *_, **__: slopes, verbose=False)  # fmt: skip
        if not found.doRetrieval(maxIter=15):
            raise RuntimeError("no convergence")
        return found

    def trials(self, n, slopes, found, seed=1):
        """chi^2 (n,) of the errors of n airs drawn from the prior by their covariance, linear about a solution."""

        def linear(x, **_):
            return found.y_op.to_numpy() + slopes @ (np.asarray(x) - found.x_op.to_numpy())

        rng, values = np.random.default_rng(seed), []
        for _ in range(n):
            x = rng.multivariate_normal(self.zero, self.s_a)
            one = self.retrieve(linear(x) + NOISE * rng.normal(size=len(self.s_y)), slopes, linear)
            error = one.x_op.to_numpy() - x
            values.append(error @ np.linalg.solve(one.S_op.to_numpy(), error))
        return np.array(values)


def draw(evening, found, path):
    """Profiles, and the rows of the averaging kernels."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    parts = {"true": evening.profiles(evening.true), "retrieved": evening.profiles(found.x_op)}
    sigma, kernels = evening.profiles(found.x_op_err), found.A_i[found.convI]
    *axes, last = figure.subplots(1, len(evening.sought) + 1)
    for axis, gas in zip(axes, evening.sought, strict=True):
        s, nodes = SPREAD[gas], NODES_KM[gas]
        axis.axvspan(np.exp(-s), np.exp(s), alpha=0.15, label="prior")
        axis.plot(np.exp(parts["true"][gas]), nodes, "k--", label="true")
        value = np.exp(parts["retrieved"][gas])
        axis.errorbar(value, nodes, xerr=value * sigma[gas], fmt="o", capsize=3, label="retrieved")
        axis.set(xlabel=f"{gas} over the prior's", ylabel="altitude [km]")
    axes[0].legend()
    for row, name in zip(kernels, evening.names, strict=True):
        gas = name.split()[0]
        last.plot(evening.profiles(row)[gas], NODES_KM[gas], "-" if gas == "ozone" else "--", label=name)
    last.set(xlabel="averaging kernels", title=f"{found.dgf:.1f} degrees of freedom")
    last.legend(fontsize="x-small")
    figure.savefig(path, dpi=110)


def main(sought):
    """One retrieval, and trials."""
    evening = Twilight(sought)
    slopes, noise = evening.jacobian(), NOISE * np.random.default_rng(0).normal(size=len(evening.s_y))
    found = evening.retrieve(evening.forward(evening.true) + noise, slopes)
    table = {"true": evening.true, "retrieved": found.x_op, "sigma": found.x_op_err, "freedom": found.dgf_x}
    print(pd.DataFrame(table, evening.names).round(2), f"\n{found.dgf:.1f} degrees of freedom")
    print("posterior covariance\n", found.S_op.to_numpy().round(4), flush=True)
    draw(evening, found, f"optimal-estimation-{sought}.png")
    values, size = evening.trials(TRIALS, slopes, found), len(evening.names)
    low, high = chi2.ppf([0.005, 0.995], TRIALS * size)
    print(f"{TRIALS} trials: sum of chi^2 {values.sum():.0f}, 99 % of such sums lie from {low:.0f} to {high:.0f}")


if __name__ == "__main__":
    main(sys.argv[1])
