"""Mie optics of OPAC's components against OPAC's own tables, and the cache."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twilight.atmosphere import mie, opac, shipped_optics
from twilight.atmosphere.aerosols import mixture_optics
from twilight.numerics.phase import TABLE, PhaseFunction, rayleigh_matrix, table_angles_rad

DATA = Path(__file__).parents[1] / "data"

TABLE_EXTINCTION = 5e-3
"""Relative agreement with the extinction in OPAC's tables, 0.35 to 0.9 um."""
TABLE_ALBEDO = 2e-3
"""Agreement with the single-scattering albedo there."""
TABLE_ASYMMETRY = 1e-2
"""Agreement with the asymmetry there."""


def opac_tables() -> dict[tuple[str, float, float], tuple[float, float, float]]:
    """(component, humidity, wavelength in nm) -> extinction, albedo, asymmetry."""
    with (DATA / "opac_optical_properties.csv").open() as file:
        return {
            (row["component"], float(row["rh_percent"]), round(float(row["wavelength_um"]) * 1e3, 6)): (
                float(row["ext_per_km_per_cm3"]),
                float(row["ssa"]),
                float(row["asymmetry_g"]),
            )
            for row in csv.DictReader(file)
        }


def opac_phase_550nm() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    with (DATA / "opac_phase_550nm.csv").open() as file:
        names = file.readline().strip().split(",")
        columns = np.loadtxt(file, delimiter=",", unpack=True)
    return columns[0], dict(zip(names[1:], columns[1:], strict=True))


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    """An empty cache."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))


def optics(component, humidity, wavelength_nm):
    size, index = opac.particles(component, humidity, wavelength_nm)
    return mie.particle_optics(size, index, wavelength_nm)


def coarse_sea_salt_source_noise(component, humidity, wavelength):
    """Where OPAC's own asymmetry is a coarse integral: very large spheres (see the test on its phase function)."""
    return component == "sscm" and humidity >= 95


def check_against_tables(populations, wavelengths):
    tables = opac_tables()
    for component, humidity in populations:
        got = optics(component, humidity, np.array(wavelengths))
        for i, wavelength in enumerate(wavelengths):
            extinction, albedo, asymmetry = tables[component, humidity, wavelength]
            label = f"{component} {humidity:g} % {wavelength:g} nm"
            ratio = got.extinction_per_km[i] / extinction
            if (component, humidity) == ("suso", 50.0):
                assert 1.005 < ratio < 1.012, label  # explained in test_suso_at_50_percent
            elif coarse_sea_salt_source_noise(component, humidity, wavelength):
                assert ratio == pytest.approx(1.0, abs=8e-3), label
            else:
                assert ratio == pytest.approx(1.0, abs=TABLE_EXTINCTION), label
            assert got.scattering_per_km[i] / got.extinction_per_km[i] == pytest.approx(albedo, abs=TABLE_ALBEDO), label
            tolerance = 0.025 if coarse_sea_salt_source_noise(component, humidity, wavelength) else TABLE_ASYMMETRY
            assert got.asymmetry[i] == pytest.approx(asymmetry, abs=tolerance), label


def test_against_opac_tables_shipped():
    """Shipped optics of the populations of the ten types would not be OPAC's."""
    check_against_tables(opac.populations(), [550.0])


def test_against_opac_tables_computed(tmp_path):
    """Computed optics of a component would not be OPAC's."""
    check_against_tables([("waso", 0.0), ("soot", 0.0), ("minm", 0.0)], [900.0])
    assert len(list(tmp_path.rglob("*.npz"))) == 3


@pytest.mark.slow
@pytest.mark.parametrize("component", opac.components())
def test_against_opac_tables_all(component):
    """Computed optics of some component, humidity or wavelength would not be OPAC's."""
    wavelengths = sorted({w for _, _, w in opac_tables() if 350 <= w <= 900})
    assert len(wavelengths) == 11
    check_against_tables([(component, h) for h in opac.humidity_classes(component)], wavelengths)


def test_suso_at_50_percent():
    """OPAC's table for sulphate at 50 % belongs to a median radius of 0.0980 um, not to its printed 0.0983 um.

    One radius explains the whole spectrum, and agrees with the index, which says how much water there is.
    """
    tables = opac_tables()
    wavelengths = np.array([550.0, 900.0])
    size, index = opac.particles("suso", 50.0, wavelengths)
    got = mie.particle_optics(replace(size, median_radius_um=0.0980), index, wavelengths)
    expected = [tables["suso", 50.0, w][0] for w in wavelengths]
    np.testing.assert_allclose(got.extinction_per_km, expected, rtol=1.5e-3)


PHASE_RMS = {"sscm": 0.05, "micm": 0.03, "ssam": 0.03}
"""Relative difference to OPAC's phase functions from 1 to 170 deg: large spheres ripple, both sides sample radii."""


SHIPPED = opac.populations()
OTHERS = [(c, h) for c in opac.components() for h in opac.humidity_classes(c) if (c, h) not in SHIPPED]


@pytest.mark.parametrize(
    "component, humidity", [*SHIPPED, *(pytest.param(*other, marks=pytest.mark.slow) for other in OTHERS)]
)
def test_phase_function_against_opac(component, humidity):
    """A phase function would not be OPAC's."""
    angle_deg, phases = opac_phase_550nm()
    got = optics(component, humidity, [550.0])
    phase = PhaseFunction(TABLE, got.asymmetry, got.log_phase)(np.cos(np.radians(angle_deg)))[0]
    error = phase / phases[f"{component}{humidity:02.0f}"] - 1.0
    assert np.abs(error[angle_deg < 1]).max() < 0.012
    middle = (angle_deg >= 1) & (angle_deg <= 170)
    assert np.sqrt(np.mean(error[middle] ** 2)) < PHASE_RMS.get(component, 0.01)


def test_phase_table_is_normalised_and_keeps_the_asymmetry():
    """A tabulated phase function would not conserve energy, or lose its asymmetry."""
    for component, humidity in opac.populations():
        got = optics(component, humidity, [550.0])
        moments = PhaseFunction(TABLE, got.asymmetry, got.log_phase).legendre_moments(1)[0]
        assert moments[0] == pytest.approx(1.0, abs=2e-6)
        assert moments[1] == pytest.approx(got.asymmetry[0], abs=1e-4)


def test_small_spheres_are_rayleigh_scatterers():
    """x << 1: scattering goes with x^4, with the phase matrix of molecules."""
    size = mie.LogNormal(1e-3, 1.2, 1e-4, 1e-2)
    got = mie.particle_optics(size, [1.5, 1.5], [400.0, 800.0])
    assert got.scattering_per_km[0] / got.scattering_per_km[1] == pytest.approx(16.0, rel=1e-3)
    p11, p12, p22, p33 = rayleigh_matrix.py_func(np.cos(table_angles_rad(mie.N_ANGLES)), 0.0)
    np.testing.assert_allclose(np.exp(got.log_phase[0]), p11, rtol=2e-3)
    np.testing.assert_allclose(got.ratios[:3, 0], [p12 / p11, p22 / p11, p33 / p11], atol=2e-3)
    np.testing.assert_allclose(got.ratios[3, 0], 0.0, atol=1e-3)


@pytest.mark.parametrize("index", [1.5 - 0.01j, 1.33 - 0j, 1.75 - 0.44j, 1.1 - 1e-8j, 2.5 - 2j, 0.8 - 0.1j])
def test_coefficients_are_those_of_miepython(index):
    """A Mie coefficient would be off by more than 1e-10 of the largest, also of a sphere among larger ones.

    miepython itself is off by 1.9e-10 for x = 900, m = 1.1 - 1e-8 i, n = 921, where ours is by 1.4e-12 (40 digits).
    """
    import miepython

    x = np.geomspace(0.01, 900.0, 60)
    for i, (a, b) in enumerate(zip(*mie.coefficients(index, x), strict=True)):
        for one, other in zip((a, b), miepython.coefficients(index, x[i]), strict=True):
            n = min(one.size, other.size)
            np.testing.assert_allclose(
                one[:n], other[:n], rtol=0.0, atol=(1e-10 if x[i] < 100.0 else 1e-9) * np.abs(other).max()
            )
            assert np.abs(one[n:]).max(initial=0.0) < 1e-6 and np.abs(other[n:]).max(initial=0.0) < 1e-6


def test_population_of_one_size_is_one_sphere():
    """A narrow distribution has the cross sections and intensities that miepython gives for the sphere itself."""
    import miepython

    radius, wavelength, index = 0.3, 0.55, 1.5 - 0.01j
    size = mie.LogNormal(radius, 1.0005, 0.25, 0.35)
    got = mie.particle_optics(size, [index], [wavelength * 1e3])
    x = 2 * np.pi * radius / wavelength
    q_ext, q_sca, _, g = miepython.efficiencies_mx(index, x)
    area = np.pi * radius**2 * 1e-3
    assert got.extinction_per_km[0] == pytest.approx(q_ext * area, rel=1e-4)
    assert got.scattering_per_km[0] == pytest.approx(q_sca * area, rel=1e-4)
    assert got.asymmetry[0] == pytest.approx(g, abs=1e-4)
    mu = np.cos(np.radians([0.0, 20.0, 90.0, 150.0, 180.0]))
    sphere = miepython.i_unpolarized(index, x, mu, norm="one")
    np.testing.assert_allclose(PhaseFunction(TABLE, got.asymmetry, got.log_phase)(mu)[0], sphere, rtol=2e-3)


def test_shipped_rows_are_what_the_code_computes():
    """A sample of the shipped file, computed anew; every population of the ten types is in it."""
    shipped = shipped_optics.load()
    assert len(shipped) == (len(opac.populations()) + 4) * len(shipped_optics.WAVELENGTHS_NM)
    for component, humidity, wavelength in (
        ("waso", 80.0, 550.0),
        ("soot", 0.0, 380.0),
        ("suso", 0.0, shipped_optics.WAVELENGTHS_NM[4]),
    ):
        size, index = opac.particles(component, humidity, [wavelength])
        key = mie.cache_key(size, complex(index[0]), wavelength)
        np.testing.assert_allclose(shipped[key], mie.compute_optics(size, index[0], wavelength), rtol=2e-6)


def test_damaged_shipped_file_is_not_used(monkeypatch):
    """Numbers of a damaged file would be used."""
    monkeypatch.setattr(shipped_optics, "_digest", lambda *_: "another")
    shipped_optics.load.cache_clear()
    try:
        assert shipped_optics.load() == {}
    finally:
        shipped_optics.load.cache_clear()


@pytest.fixture
def small():
    return mie.LogNormal(0.02, 1.5, 0.005, 0.2), np.array([1.5 - 0.01j])


def test_cache_returns_the_same_numbers(small, monkeypatch):
    """A cached result would differ from a computed one."""
    first = mie.particle_optics(*small, [500.0])

    def not_again(*_):
        raise AssertionError("computed although cached")

    monkeypatch.setattr(mie, "compute_optics", not_again)
    second = mie.particle_optics(*small, [500.0])
    np.testing.assert_array_equal(first.log_phase, second.log_phase)
    np.testing.assert_array_equal(first.ratios, second.ratios)
    np.testing.assert_array_equal(first.extinction_per_km, second.extinction_per_km)


def test_damaged_cache_entry_is_computed_again(tmp_path, small):
    """Numbers of a damaged cache entry would be used (`test_cache` has other damages)."""
    first = mie.particle_optics(*small, [500.0])
    (entry,) = tmp_path.rglob("*.npz")
    raw = bytearray(entry.read_bytes())
    raw[1000] ^= 1
    entry.write_bytes(raw)
    again = mie.particle_optics(*small, [500.0])
    np.testing.assert_array_equal(first.log_phase, again.log_phase)
    assert entry.stat().st_size > 8 * mie.ROW
    assert not list(tmp_path.rglob("*.part"))


def test_cache_key_depends_on_everything(small):
    """Two populations would find each other's optics in the cache."""
    size, index = small
    keys = {
        mie.cache_key(size, index[0], 500.0),
        mie.cache_key(size, index[0], 500.1),
        mie.cache_key(size, index[0] + 1e-6, 500.0),
        mie.cache_key(size, index[0] + 1e-6j, 500.0),
        *(
            mie.cache_key(replace(size, **{name: 1.001 * getattr(size, name)}), index[0], 500.0)
            for name in ("median_radius_um", "sigma", "min_radius_um", "max_radius_um")
        ),
    }
    assert len(keys) == 8


def test_optics_between_spectral_nodes():
    """Interpolated optics of many wavelengths would differ from computed ones; few would be interpolated too."""
    nm = np.linspace(420.0, 470.0, 51)  # across 450 nm, where OPAC's index has a kink
    size, index = opac.particles("waso", 80.0, nm)
    nodes = mie.spectral_nodes(index, nm)
    assert nodes[0] == 0 and nodes[-1] == 50 and 5 <= nodes.size <= 9
    got = mie.particle_optics(size, index, nm)
    for i in (5, 29, 43):
        assert i not in nodes
        computed = mie.particle_optics(size, index[i : i + 1], nm[i : i + 1])
        assert got.extinction_per_km[i] == pytest.approx(computed.extinction_per_km[0], rel=2e-4)
        assert got.scattering_per_km[i] == pytest.approx(computed.scattering_per_km[0], rel=2e-4)
        assert got.asymmetry[i] == pytest.approx(computed.asymmetry[0], abs=1e-4)
        np.testing.assert_allclose(got.log_phase[i], computed.log_phase[0], atol=5e-3)
        np.testing.assert_allclose(got.ratios[:, i], computed.ratios[:, 0], atol=3e-3)
    assert mie.spectral_nodes(index[::10], nm[::10]).size == 6  # whoever asks for few has each computed
    assert mie.spectral_nodes(index[::-1], nm[::-1]).size == 51


HUMIDITY_LEFT_OUT = {50.0: 0.08, 70.0: 0.025, 80.0: 0.025, 90.0: 0.025, 95.0: 0.025, 98.0: 0.025}
"""Change of extinction when a class is interpolated from the others."""


def check_humidity_left_out(component, humidity, wavelength):
    with_it = optics(component, humidity, wavelength)
    size, index = opac.particles(component, humidity, wavelength, leave_out_percent=humidity)
    without = mie.particle_optics(size, index, wavelength)
    ratio = without.extinction_per_km / with_it.extinction_per_km
    np.testing.assert_allclose(ratio, 1.0, atol=HUMIDITY_LEFT_OUT[humidity])
    assert np.all(ratio != 1.0)
    np.testing.assert_allclose(without.asymmetry, with_it.asymmetry, atol=6e-3)


@pytest.mark.parametrize("humidity", [50.0, 80.0])
def test_humidity_interpolation_without_one_class(humidity):
    """Interpolated swelling would miss a humidity class that is left out by more than documented."""
    check_humidity_left_out("waso", humidity, [800.0])


@pytest.mark.slow
@pytest.mark.parametrize("humidity", HUMIDITY_LEFT_OUT)
@pytest.mark.parametrize("component", ["waso", "suso", "ssam", "sscm"])
def test_humidity_interpolation_without_one_class_all(component, humidity):
    """Interpolated swelling would miss some component's class by more than documented."""
    check_humidity_left_out(component, humidity, [400.0, 550.0, 800.0])


def test_humidity_interpolation_is_continuous_and_monotone():
    """Optics would jump from one humidity to the next."""
    for component in ("waso", "suso", "ssam", "sscm"):
        classes = opac.humidity_classes(component)
        humidity = np.unique(np.concatenate([np.linspace(0, 99, 199), classes]))
        radius = [opac.particles(component, h, 550.0)[0].median_radius_um for h in humidity]
        assert np.all(np.diff(radius) > 0)
        for h in classes[1:]:
            below = opac.particles(component, h - 1e-9, 550.0)
            at = opac.particles(component, h, 550.0)
            assert below[0].median_radius_um == pytest.approx(at[0].median_radius_um, rel=1e-6)
            assert below[1][0] == pytest.approx(at[1][0], rel=1e-6)


def test_mixture_is_weighted_with_scattering():
    """A mixture's phase function would not be the mean weighted with scattering."""
    numbers = {"waso": 7000.0, "soot": 8300.0}
    mixed = mixture_optics(numbers, 80.0, [550.0])
    parts = {c: optics(c, 80.0 if c == "waso" else 0.0, [550.0]) for c in numbers}
    extinction = sum(n * parts[c].extinction_per_km[0] for c, n in numbers.items())
    scattering = {c: n * parts[c].scattering_per_km[0] for c, n in numbers.items()}
    assert mixed.extinction_per_km[0] == pytest.approx(extinction, rel=1e-12)
    assert mixed.single_scattering_albedo[0] == pytest.approx(sum(scattering.values()) / extinction, rel=1e-12)
    g = sum(scattering[c] * parts[c].asymmetry[0] for c in numbers) / sum(scattering.values())
    assert mixed.phase.asymmetry[0] == pytest.approx(g, abs=1e-5)
    henyey = mixture_optics(numbers, 80.0, [550.0], "henyey_greenstein")
    assert henyey.phase.kind == 0 and henyey.phase.asymmetry[0] == pytest.approx(g, abs=1e-12)
