"""The light of every clear sky, from one file, `data/compact/clear-air.npz`.  This folder, copied to wherever it is
wanted, needs numpy alone.

    from clear_air import Air, Model, Skies
    skies = Skies(Model.load("clear-air.npz"), Air(**numpy.load("air.npz")), observer_km=0.0)
    light = skies.sky(-4.0).light(elevation_deg, azimuth_deg, n_stokes=3)       # (E, A, 3, W) [sr^-1]

Several airs over one Earth are one `Air` whose wavelengths stand side by side.  Derivatives: give the air an imaginary
part of `STEP` times a direction (`Air.towards`); that of the light is STEP x its derivative.

    L / F0 = sum_k P_k(angle from the sun) Q_k  +  M,        M = M_0 exp(sum_n c_n v_n(sun, elevation, azimuth))

Q_k, of scattering by air and each aerosol, are integrals along refracted lines of sight through spherical shells
(`shells`); P_k are the phase functions, their forward peaks widened (`skies`).  M_0 are orders of scattering in fewer
layers and directions (`diffuse`, along `rays`).  c_n, one set for each wavelength, air and observer, for every sun, are
the mean of some small networks of what names the air and of ln M_0 under all suns (`model`); v_n are principal
components of ln(M / M_0) in air that `zones` has solved.  Q / M and U / M are sums of the same kind.

The file is a zip of arrays (.npy), S = 32 suns `SUN_DEG`, E = 15 and A = 13 nodes over the sky:

    format "twilight clear air 3"; provenance: how it was fitted, as JSON
    base_mean (480,), base_vectors (48, 480): components of ln M_0 at `BASE_ELEVATION_DEG` x `BASE_AZIMUTH_DEG`
    input_mean, input_scale (138,): of the inputs: 90 of the air, then 48 components
    layers (members, 5), weights: sizes of each network's layers; then its weights (I, O) and offsets (O,) in a row.
        Hidden layers have the activation silu; all but the first add their input
    intensity_mean (S E A,), intensity (128, S E A), intensity_scale (128,): v_n are intensity x scale
    polarisation_mean (2 S E A,), polarisation, polarisation_scale: of Q / M, then U / M
    limits (10, 2): least and largest of what `clear_air.of_medium.LIMITED` names in the airs of the fit
    error (2, S): the error at 95 % of a sky is error[0] + error[1] x spread of the networks
"""

from .model import Model
from .shells import Air
from .skies import Skies

__all__ = ["Air", "Model", "Skies"]
