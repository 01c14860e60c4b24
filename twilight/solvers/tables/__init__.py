"""Tables: the precomputed atmospheric scattering of Bruneton and Neyret 2008, spectral, for any medium and viewpoint.

Transmittance T(r, mu), irradiance of the ground E(r, mu_s) and inscattered light S(r, mu, mu_s, nu), filled order by
order (their Algorithm 4.1) and read in constant time.  Rays are straight, as in the paper: there is no refraction.
"""

from twilight.solvers.base import Capabilities
from twilight.solvers.tables.algorithm import QUALITIES, TablesSettings, cost
from twilight.solvers.tables.field import TablesField, prepare

CAPABILITIES = Capabilities(
    every_sun=True,
    every_observer=True,
    finite_segments=True,
    screen=True,
    straight_rays=True,
    wavelengths_at_once=16,
    cost=cost,
)

__all__ = ["CAPABILITIES", "QUALITIES", "TablesField", "TablesSettings", "prepare"]
