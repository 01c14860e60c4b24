"""What the referee says about orders of scattering and about Haber's isotropic assumption.

    python benchmarks/montecarlo_tables.py            prints a CSV table

Per climate and sun: orders that give 99 % of the radiance (median and largest over the views; an order is an event, the
ground's reflections included), the relative error of `isotropic_after_first` (median and largest over the views, with
the noise of one view), and multiple over single scattering in the zenith.
"""

from __future__ import annotations

import numpy as np

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

WAVELENGTH_NM = 450.0
CLIMATES = ("pure-air", "continental-average")
SUNS_DEG = (30.0, 10.0, 0.0, -4.0, -6.0, -9.0, -12.0, -15.0, -18.0)
VIEWS_DEG = ((90.0, 0.0), *((e, a) for e in (5.0, 20.0, 45.0) for a in (0.0, 90.0, 180.0)))
TARGET = 0.01
HEADER = (
    "climate,sun_elevation_deg,orders for 1 % (median),orders for 1 % (largest),"
    "isotropic error (median) [%],isotropic error (largest) [%],noise of one view [%],multiple/single at zenith"
)


def main() -> None:
    """Print the table."""
    elevation, azimuth = np.array(VIEWS_DEG).T
    print(f"# {WAVELENGTH_NM:g} nm, views {VIEWS_DEG}, standard error {100 * TARGET:g} %")
    print(HEADER)
    for climate in CLIMATES:
        medium = climate_medium(load_climate(climate), np.array([WAVELENGTH_NM]))
        # without the coarse field's part the orders add up to the radiance, and share its error
        exact = prepare(medium, MonteCarloSettings(target_stderr=TARGET, seed=3, coarse_control=False))
        haber = prepare(medium, MonteCarloSettings(target_stderr=TARGET, seed=4, approximation="isotropic_after_first"))
        for sun in SUNS_DEG:
            a = exact.radiance_with_error(sun, elevation, azimuth)
            b = haber.radiance_with_error(sun, elevation, azimuth)
            share = np.cumsum(a.order_radiance[..., 0], axis=0) / a.radiance[:, 0]
            orders = 1 + np.argmax(share >= 0.99, axis=0)
            error = 100 * np.abs(b.radiance / a.radiance - 1)[:, 0]
            noise = 100 * np.hypot(a.standard_error / a.radiance, b.standard_error / b.radiance)[:, 0]
            single = a.order_radiance[0, 0, 0]
            ratio = (a.radiance[0, 0] - single) / single if single > 0 else np.inf
            print(
                f"{climate},{sun:g},{np.median(orders):g},{orders.max()},{np.median(error):.1f},{error.max():.1f},"
                f"{np.median(noise):.1f},{ratio:.3g}",
                flush=True,
            )


if __name__ == "__main__":
    main()
