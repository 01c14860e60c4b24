"""What a solver is: its module, the field that it prepares, and what it declares to be able to do.

A new solver is two files: its module (or package), and one line in the registry `twilight.solvers.SOLVERS`.  The module
has what `Solver` lists:

- `CAPABILITIES`, what the solver can do beyond the least, as `Capabilities`; nothing outside asks in another way;
- `QUALITIES`, its presets by name, of a class made with `twilight.base.sections.settings`, whose options say default,
  help and limits; `standard` is one of them; an option of one of these names has one meaning: `polarisation` (true:
  the field is a `PolarisedField`), `spectrum` (whether the fitted model carries light to many wavelengths from a few),
  `field_file` (where the field of one block of wavelengths is stored),
  `target_error` (the relative systematic error that it is to have) and `target_stderr` (a relative standard error
  that samples are added for);
- `tuned_numbers()`, where a solver has them, and `kinds_met(medium, settings)`, which of their kinds of air a medium
  is: rows of name, value, unit, air, test and meaning of what tunes its
  algorithm, which `twilight show solvers NAME` prints;
- `recorded(settings)`, where settings may name files: the same with what is in them in place of their paths;
- `prepare(medium, settings, *, observer_altitude_km, progress)`, which computes what depends on neither sun nor
  direction and returns a `Field`, or raises TwilightError.

`twilight.engine` does the rest: blocks of wavelengths, observers, suns, the sunbeam, errors and files.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress


@dataclass(frozen=True)
class Cost:
    """Memory and processor time of a field.

    fixed_bytes: of the field, whatever its wavelengths
    bytes_per_wavelength, cpu_s_per_wavelength: of each wavelength; of each block of `block_size` wavelengths, begun or
        full, they count block_size times
    cpu_s_per_direction: of a wavelength in one direction, when the field is evaluated
    cpu_s_per_sun: of a wavelength under each sun, where the field is solved for one after the other
    block_size: wavelengths that are computed as one
    band_bytes: added to fixed_bytes where the wavelengths are terms of a gas's exponential sum
    band_cpu_factor: of cpu_s_per_wavelength where they are such terms
    """

    fixed_bytes: float
    bytes_per_wavelength: float
    cpu_s_per_wavelength: float
    cpu_s_per_direction: float
    block_size: int = 1
    band_bytes: float = 0.0
    band_cpu_factor: float = 1.0
    cpu_s_per_sun: float = 0.0

    def n_bytes(self, wavelengths: int, in_band: bool = False) -> float:
        """Bytes of a field of so many wavelengths; in_band: or so many terms of an exponential sum."""
        fixed = self.fixed_bytes + (self.band_bytes if in_band else 0.0)
        return fixed + self.bytes_per_wavelength * self.block_size * -(-wavelengths // self.block_size)

    def max_wavelengths(self, most: int, n_bytes: float, in_band: bool = False) -> int:
        """The most wavelengths of a field of at most n_bytes bytes: up to `most`, at least `block_size`."""
        fixed = self.fixed_bytes + (self.band_bytes if in_band else 0.0)
        room = (n_bytes - fixed) / (self.bytes_per_wavelength * self.block_size)
        return max(self.block_size, min(most, self.block_size * int(max(room, 0.0))))


@dataclass(frozen=True)
class Capabilities:
    """What a solver can do beyond the least that is asked of one, which the defaults describe.

    kind: `transport`, light in the medium's coefficients; `fitted`, a model fitted to that; `formula`, light of a
        formula, to which bands of gases mean nothing, for a sun above the horizon; neither of these two has a compiled
        kernel, and the engine takes the sun's light at the ground from numpy alone
    takes_suns: `prepare` also takes `sun_elevations_deg`, all the suns that will be asked for (None: any), and computes
        only what they need
    every_sun: one field gives the sky of every sun, day to night, at a small part of the cost of the field
    every_observer: `Field.radiance` also takes `observer_altitude_km`: one field serves every altitude
    looks_down: directions may be below the horizon
    standard_error: radiances are estimates; the field is a `StochasticField`
    screen: it takes a medium with something beyond the horizon that dims the direct beam (`Medium.screen`)
    finite_segments: the field is a `SegmentField`
    straight_rays: neither lines of sight nor the sunbeam are bent, whatever the refractive index of the medium
    simple_phases: air scatters alike in all directions, whatever its depolarisation, and aerosol by Henyey and
        Greenstein's function of its mean cosine
    wavelengths_at_once: most wavelengths of one `prepare`; the engine divides more into blocks of so many
    spectral_groups: a key for each wavelength of a medium under settings; wavelengths of different keys must not be
        solved in one block, where each would move the other's radiance; None: no wavelength moves another
    carried: whether under settings the light of many wavelengths is carried from a few by the fitted model
        (`twilight.engine.carried`); None: never
    cost: cost of a field from (medium, settings, sun elevations or None for any, altitude of the observer); None, or
        where that gives None: not known
    expected_error: error [fraction] that 95 % of radiances are expected to stay within, from (medium, settings, lowest
        sun, altitude of the observer); infinite where it was not measured in such air; None: the solver does not say
    package: name of a Python package that it needs beside those of twilight, which the extra `peers` installs
    """

    kind: Literal["transport", "fitted", "formula"] = "transport"
    takes_suns: bool = False
    every_sun: bool = False
    every_observer: bool = False
    looks_down: bool = True
    standard_error: bool = False
    screen: bool = False
    finite_segments: bool = False
    straight_rays: bool = False
    simple_phases: bool = False
    wavelengths_at_once: int = 32
    spectral_groups: Callable[[Medium, Any], Sequence[Hashable]] | None = None
    carried: Callable[[Any], bool] | None = None
    cost: Callable[[Medium, Any, Sequence[float] | None, float], Cost | None] | None = None
    expected_error: Callable[[Medium, Any, float, float], float] | None = None
    package: str = ""

    @property
    def installed(self) -> bool:
        """Whether the package that the solver needs is there."""
        return not self.package or find_spec(self.package) is not None


ALL_WAVELENGTHS = 2000
"""`wavelengths_at_once` of solvers that take as many as a configuration may have."""


@dataclass(frozen=True)
class Convergence:
    """How well a field was solved.

    orders: orders of scattering that were followed; residual: largest fraction of the light that may be missing or
    wrong because no more were followed; error: how far two qualities differ at 95 % of the directions, where a target
    was asked for; spectral_nodes: wavelengths, or terms of exponential sums, from which the fitted model carried
    light to the others, where it did, and interpolation_error: what that added at 95 % of the directions.
    """

    orders: int
    residual: float
    error: float | None = None
    spectral_nodes: int | None = None
    interpolation_error: float | None = None


@dataclass(frozen=True)
class ModelError:
    """How far off a fitted model is by its own estimate: error, relative, at 95 % of the directions."""

    error: float


class Field(Protocol):
    """A solved medium, seen by one observer, that is asked for suns and directions."""

    @property
    def medium(self) -> Medium:
        """The medium that it was prepared for."""

    @property
    def convergence(self) -> Convergence | ModelError | None:
        """How well it was solved so far, where the solver iterates, or how near a fitted model is."""

    @property
    def facts(self) -> Mapping[str, float]:
        """What the record of a sky is to say about the model, e.g. the turbidity that a formula takes."""

    @property
    def polarised(self) -> bool:
        """Whether it was prepared with polarisation; it is then a `PolarisedField`."""

    def radiance(self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Sun-normalised radiance.

        Parameters
        ----------
        sun_elevation_deg
            True elevation of the sun's centre [deg].
        elevation_deg, azimuth_deg
            Of the lines of sight [deg], azimuth from the sun; they are broadcast.  The sky is its own mirror image
            about the sun's vertical.  A solver that serves `every_observer` takes `observer_altitude_km` too (None: as
            prepared).

        Returns
        -------
        array
            [sr^-1], shape of the directions plus (W,).

        Raises
        ------
        TwilightError
            For a sun or a direction that the solver cannot do.
        """


def check_sun(sun_elevation_deg: float) -> None:
    """TwilightError for an elevation that no sun has."""
    if not -90.0 <= sun_elevation_deg <= 90.0:
        raise TwilightError(f"sun.elevation_deg is {sun_elevation_deg:g}; allowed is -90 to 90")


class BareField:
    """The base of fields that do not iterate, or have nothing to say about their model."""

    convergence: Convergence | ModelError | None = None
    facts: Mapping[str, float] = MappingProxyType({})

    @property
    def polarised(self) -> bool:
        """Without Stokes parameters."""
        return False


class Estimate(Protocol):
    """Radiance with its standard error [sr^-1], both of the same shape."""

    @property
    def radiance(self) -> np.ndarray: ...

    @property
    def standard_error(self) -> np.ndarray: ...


class StochasticField(Field, Protocol):
    """A field whose answers are estimates; every direction costs, and none is the mirror image of another."""

    def radiance_with_error(
        self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike
    ) -> Estimate:
        """Radiance as of `Field.radiance`, with its standard error; it may be below 0 by its noise."""


class PolarisedField(Field, Protocol):
    """A field that knows the linear polarisation of its light."""

    def stokes(self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U, with the signs of `twilight.base.conventions`.

        Parameters
        ----------
        sun_elevation_deg, elevation_deg, azimuth_deg
            As of `Field.radiance`.

        Returns
        -------
        array
            [sr^-1], shape of the directions plus (3, W); I is what `radiance` gives.  A field whose answers are
            estimates has `stokes_with_error` too: `stokes` and `standard_error`, both of this shape.

        Raises
        ------
        TwilightError
            For a field without polarisation.
        """


class SegmentField(Field, Protocol):
    """A field that knows the air between the observer and an object."""

    def inscatter(
        self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, distance_km: ArrayLike
    ) -> tuple[np.ndarray, np.ndarray]:
        """Light scattered in between the observer and a distance, and the transmittance of that air.

        An object of radiance L at that distance is seen as radiance + transmittance x L.  Beyond the end of a line, at
        the ground or in space, both are those of the whole line.

        Parameters
        ----------
        sun_elevation_deg, elevation_deg, azimuth_deg
            As of `Field.radiance`.  A solver that scales forward peaks takes `peak_passes` too: light that aerosol
            scatters into its narrow forward peak then counts as passed, in both results, as fits objects wider than the
            peak (degrees).
        distance_km
            Length of the segments [km], broadcast with the directions.

        Returns
        -------
        radiance, transmittance : arrays
            [sr^-1] and 1, shape of the directions plus (W,).  A field whose answers are estimates has
            `inscatter_with_error` too, an `Estimate` in the place of the radiance.
        """


class Solver(Protocol):
    """The module of a solver."""

    __name__: str

    @property
    def CAPABILITIES(self) -> Capabilities: ...

    @property
    def QUALITIES(self) -> Mapping[str, Any]: ...

    def prepare(
        self,
        medium: Medium,
        settings: Any = None,
        *,
        observer_altitude_km: float = 0.0,
        progress: Progress | None = None,
    ) -> Field:
        """Make what does not depend on the sun and the direction.

        Parameters
        ----------
        medium
            Coefficients of air, aerosol and gases at W wavelengths, and the ground.
        settings
            One of QUALITIES, perhaps with options replaced; None: `standard`.
        observer_altitude_km
            Altitude of the observer [km].
        progress
            Called as progress(doing, fraction) now and then.

        A solver that `takes_suns` also takes `sun_elevations_deg`: all the suns that will be asked for, None for any.

        Raises
        ------
        TwilightError
            For what the solver cannot do, in one sentence.
        """
