"""Units, angles and names.

Lengths are in km, coefficients in km^-1, wavelengths in nm (vacuum), pressures in hPa, temperatures in K, number
densities in cm^-3, ozone columns in Dobson units (DU).  The unit is part of a name: ``altitude_km``,
``extinction_per_km``, ``sun_elevation_deg``.  Angles are in degrees at the API and in radians inside kernels.

*Radiance.*  Solvers return the **sun-normalised radiance** ``L / F0`` in sr^-1: the radiance for a solar irradiance of
1 at normal incidence on top of the atmosphere.  ``Sky`` multiplies it by the solar spectrum (W m^-2 nm^-1).  The
sun-normalised radiance is smooth in wavelength and is interpolated (in its logarithm); the product never is.

*Sun.*  ``sun_elevation_deg`` is the true (unrefracted) elevation of the centre of the disc, seen from the observer.
``cos_sun_zenith`` in kernels is the cosine of the angle between the *local* vertical of a point of the air and the true
direction of the sun.

*Directions.*  A viewing direction points from the observer to the sky.  ``elevation_deg`` is 0 at the geometric
horizontal and 90 in the zenith.  Inside solvers ``azimuth_deg`` is relative to the sun: 0 towards the sun, growing
clockwise seen from above.  In the world it is clockwise from north.

*Cartesian frame of an observer.*  z up, x towards the azimuth of the sun, y 90 deg clockwise from it seen from above.
The origin of positions is the centre of the Earth, the observer stands at (0, 0, R + h).

*Polarisation.*  Stokes parameters I, Q, U, in the place before wavelength: ``stokes[direction, 3, wavelength]``,
sun-normalised like the radiance, which is I.  The reference plane is the vertical plane through the line of sight, in
the zenith that of the azimuth given.  Q > 0: light vibrates in that plane; Q < 0: horizontally.  U > 0: for somebody
who looks along the line of sight, zenith side up, the vibration leans from the vertical to the right (clockwise),
towards larger azimuth.  The angle of vibration, clockwise from the vertical, is atan2(U, Q) / 2; the degree of linear
polarisation is sqrt(Q^2 + U^2) / I.  About the sun's vertical I and Q are mirrored, U changes its sign.  (The signs of
Emde et al. 2015, IPRT, J. Quant. Spectrosc. Radiat. Transfer 164, 8; Hovenier and van der Mee 1983.)

*Scattering angle.*  0 is forward.  A phase function is per steradian, its integral over the sphere is 1.

*Array order.*  Directions first, wavelength last: ``radiance[direction, wavelength]``,
``radiance[elevation, azimuth, wavelength]``, ``stokes[direction, I Q U, wavelength]``; profiles are
``[level, wavelength]``.
"""

UNSEEN = 1e-12
"""Radiance over F0 [sr^-1] that nobody sees: a thousandth of the darkest night, 1e-7 cd m^-2."""

LEAST_LUMINANCE = 1e-12
"""Luminance [cd m^-2] in whose place 0 has no logarithm: a millionth of what an eye in the dark sees."""

DARK = 1e-30
"""Radiance over F0 [sr^-1], transmittance or coefficient [km^-1] that counts as none where a logarithm or a ratio is
taken."""

TINY_SINGLE = 1e-37
"""The same of any number in single precision, whose least normal number is 1.2e-38."""

TINY = 1e-300
"""The same of any number in double precision, whose least normal number is 2.2e-308."""

ROUNDING = 1e-9
"""Difference, relative or of angles [deg] and altitudes [km], that rounding of what people write may make."""

EARTH_RADIUS_KM = 6371.0
"""Mean radius of the Earth (Haber 2005 sec. 4.1.3; IUGG mean radius 6371.0088 km)."""

LOWEST_GROUND_KM = -0.5
"""Altitude of the lowest ground: the shore of the Dead Sea lies at -0.43 km."""

YEARS = (1000, 3000)
"""Years for which times are taken, everywhere: those for which the motion of moon and planets is stated (Simon et al.
1994; Meeus 1998); the sun's is for -2000 to 6000 (Reda & Andreas 2004)."""

STOKES_REFERENCE = (
    "reference plane: the vertical plane through the line of sight; Q > 0: light vibrates in it; U > 0: seen along the "
    "line of sight the vibration leans from the vertical clockwise, towards larger azimuth"
)
"""What files say about Q and U."""
