"""Own aerosols of a climate: spheres by size and index, a power law, tables with a phase function."""

import math
import shutil
from dataclasses import replace

import numpy as np
import pytest

from twilight.atmosphere import opac
from twilight.atmosphere.aerosols import mixture_optics
from twilight.atmosphere.own_aerosol import SizeMode, SizeModes, read_phase
from twilight.base.errors import TwilightError
from twilight.config import load, load_climate
from twilight.config.sun import SunElevation
from twilight.numerics.phase import HENYEY_GREENSTEIN, TABLE
from twilight.scene.medium import climate_medium, table_sha256
from twilight.scene.scene import resolved_configuration

AT_NM = np.array([450.0, 550.0, 650.0])
ONLY = "free_troposphere: false, stratosphere: none, "


def climate(folder, aerosol: str, more: str = ""):
    path = folder / "own.yaml"
    path.write_text(f"version: 1\nname: own\naerosol: {{{ONLY}{aerosol}}}\n{more}")
    return path


def boundary_layer(medium) -> np.ndarray:
    return medium.at([0.0]).aerosol_extinction[0]


def test_modes_are_opac_where_they_have_its_sizes_and_indices(tmp_path):
    """A mixture of soluble matter and soot, written down by size and index, is the mixture of OPAC's components."""
    numbers = {"waso": 7000.0, "soot": 8300.0}
    modes = []
    for name, number in numbers.items():
        size, index = opac.particles(name, 0.0, AT_NM)
        lists = [AT_NM.tolist(), index.real.tolist(), (-index.imag).tolist()]
        modes.append(
            f"{{number_density_per_cm3: {number}, median_radius_um: {size.median_radius_um}, sigma: {size.sigma}, "
            f"min_radius_um: {size.min_radius_um}, max_radius_um: {size.max_radius_um}, "
            f"refractive_index: {{wavelength_nm: {lists[0]}, real: {lists[1]}, imaginary: {lists[2]}}}}}"
        )
    made = climate_medium(load_climate(climate(tmp_path, f"modes: [{', '.join(modes)}]")), AT_NM)
    want = mixture_optics(numbers, 0.0, AT_NM)
    np.testing.assert_allclose(boundary_layer(made), want.extinction_per_km, rtol=1e-9)
    np.testing.assert_allclose(made.aerosol_single_scattering_albedo[0], want.single_scattering_albedo, rtol=1e-9)
    mu = np.cos(np.radians([0.0, 5.0, 60.0, 150.0]))
    np.testing.assert_allclose(made.phase_functions[0](mu), want.phase(mu), rtol=1e-9)
    np.testing.assert_allclose(made.phase_functions[0].matrix(mu), want.phase.matrix(mu), rtol=1e-9)


def test_radii_left_out_without_being_asked_carry_no_light():
    """The default cut of a size distribution would lose light."""
    mode = SizeMode(1000.0, 0.12, 1.7, (550.0,), (1.45 - 0.005j,))
    wide = replace(mode, min_radius_um=1e-4, max_radius_um=50.0)
    got, all_of_it = (SizeModes((one,)).optics(AT_NM, "mie", "").extinction_per_km for one in (mode, wide))
    np.testing.assert_allclose(got, all_of_it, rtol=1e-3)


def test_a_power_law_has_its_exponent_and_its_optical_depth(tmp_path):
    """An Angstrom law would not have the exponent and optical depth that it states."""
    aerosol = "angstrom: {exponent: 1.4, single_scattering_albedo: 0.9, asymmetry: 0.6}, optical_depth_550nm: 0.2"
    medium = climate_medium(load_climate(climate(tmp_path, aerosol)), AT_NM)
    np.testing.assert_allclose(medium.optical_depth("aerosol"), 0.2 * (AT_NM / 550.0) ** -1.4, rtol=1e-9)
    assert medium.phase_functions[0].kind == HENYEY_GREENSTEIN
    np.testing.assert_allclose(medium.phase_functions[0].asymmetry, 0.6)
    np.testing.assert_allclose(medium.aerosol_single_scattering_albedo[0], 0.9)


@pytest.fixture
def tables(tmp_path):
    """An optics table of two wavelengths and a phase function: 1 + cos^2 at 400 nm, twice 1 + 0.5 cos at 700 nm."""
    angle = np.linspace(0.0, 180.0, 361).tolist()
    rows = [f"400,{a},{1 + math.cos(math.radians(a)) ** 2!r}" for a in angle]
    rows += [f"700,{a},{2 + math.cos(math.radians(a))!r}" for a in angle]
    (tmp_path / "phase.csv").write_text("wavelength_nm,angle_deg,phase_per_sr\n" + "\n".join(rows) + "\n")
    (tmp_path / "optics.csv").write_text(
        "# made up\nwavelength_nm,single_scattering_albedo,extinction_per_km\n700,0.8,0.05\n400,1.0,0.1\n"
    )
    (tmp_path / "with_g.csv").write_text(
        "wavelength_nm,extinction_per_km,single_scattering_albedo,asymmetry\n400,0.1,1,0.5\n700,0.05,0.8,0.7\n"
    )
    return tmp_path


def test_tables_of_optics_and_phase_function_reach_the_medium(tables):
    """Measured optics would be interpolated otherwise than documented."""
    path = climate(tables, "table: {file: optics.csv, phase_function: phase.csv}")
    at = np.array([400.0, np.sqrt(400.0 * 700.0), 700.0])
    medium = climate_medium(load_climate(path), at)
    np.testing.assert_allclose(boundary_layer(medium), [0.1, np.sqrt(0.1 * 0.05), 0.05], rtol=1e-9)
    np.testing.assert_allclose(medium.aerosol_single_scattering_albedo[0], [1.0, 0.9, 0.8], rtol=1e-9)
    phase = medium.phase_functions[0]
    assert phase.kind == TABLE
    mu = np.cos(np.radians([3.0, 40.0, 90.0, 170.0]))
    np.testing.assert_allclose(phase(mu)[0], 3.0 / (16.0 * np.pi) * (1 + mu**2), rtol=1e-4)
    np.testing.assert_allclose(phase(mu)[2], (1 + 0.5 * mu) / (4.0 * np.pi), rtol=1e-4)
    np.testing.assert_allclose(phase.asymmetry[[0, 2]], [0.0, 1 / 6], atol=1e-5)
    between = np.sqrt(phase(mu)[0] * phase(mu)[2])
    np.testing.assert_allclose(phase(mu)[1] / between, (phase(mu)[1] / between)[0], rtol=1e-4)
    plain = climate_medium(load_climate(climate(tables, "table: {file: with_g.csv}")), at)
    np.testing.assert_allclose(plain.phase_functions[0].asymmetry, [0.5, 0.6, 0.7], rtol=1e-9)
    smooth = "table: {file: optics.csv, phase_function: phase.csv}, phase_function: henyey_greenstein"
    smooth = climate_medium(load_climate(climate(tables, smooth)), at)
    assert smooth.phase_functions[0].kind == HENYEY_GREENSTEIN


def test_a_tabulated_medium_takes_a_phase_function(tables):
    """A tabulated medium would ignore a phase function of its own."""
    columns = "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km"
    columns += ",aerosol_single_scattering_albedo,absorption_per_km,refractivity"
    rows = [f"{z},{w},0.01,0.02,0.9,0,0" for w in (400, 700) for z in (0, 50)]
    (tables / "air.csv").write_text(columns + "\n" + "\n".join(rows) + "\n")
    path = tables / "tabulated.yaml"
    path.write_text("version: 1\nname: t\nmedium: {table: air.csv, phase_function: phase.csv}\n")
    medium = climate_medium(load_climate(path), None)
    assert [p.kind for p in medium.phase_functions] == [TABLE]
    np.testing.assert_allclose(medium.phase_functions[0].asymmetry, [0.0, 1 / 6], atol=1e-5)
    with pytest.raises(TwilightError, match="aerosol_asymmetry is missing"):
        climate_medium(load(path, {"medium.phase_function": None}).climate, None)


def test_a_phase_matrix_comes_with_its_elements(tmp_path):
    """Measured polarisation would be lost on the way to the medium."""
    angle = np.linspace(0.0, 180.0, 181)
    mu = np.cos(np.radians(angle))
    rows = [
        f"{a},{0.75 * (1 + c * c)!r},{(c * c - 1) / (1 + c * c)!r},{2 * c / (1 + c * c)!r},550"
        for a, c in zip(angle.tolist(), mu.tolist(), strict=True)
    ]
    (tmp_path / "p.csv").write_text("angle_deg,phase_per_sr,p12_ratio,p33_ratio,wavelength_nm\n" + "\n".join(rows))
    phase = read_phase(tmp_path / "p.csv", np.array([550.0]))
    elements = phase.matrix(np.cos(np.radians([30.0, 90.0])))[:, 0]
    np.testing.assert_allclose(elements[1] / elements[0], [-1 / 7, -1.0], atol=2e-3)
    np.testing.assert_allclose(elements[3] / elements[0], [2 * np.sqrt(0.75) / 1.75, 0.0], atol=2e-3)


def test_files_are_found_beside_the_climate_and_recorded_by_their_content(tables):
    """A record would not tell which file was used, or accept another one."""
    path = climate(tables, "table: {file: optics.csv, phase_function: phase.csv}")
    config = load(path)
    assert config.climate.aerosol.table.file == str(tables / "optics.csv")
    record = resolved_configuration(config, SunElevation())["climate"]["aerosol"]["table"]
    assert record["file"] == "optics.csv" and record["sha256"] == table_sha256(tables / "optics.csv")
    assert record["phase_function_sha256"] == table_sha256(tables / "phase.csv")
    shutil.copy(tables / "phase.csv", tables / "other.csv")
    other = load(path, {"aerosol.table.phase_function": str(tables / "other.csv")})
    assert other.climate.aerosol.table.phase_function == str(tables / "other.csv")
    (tables / "optics.csv").write_text((tables / "with_g.csv").read_text())
    wrong = {"aerosol.table.sha256": record["sha256"]}
    with pytest.raises(TwilightError, match=r"is not the table of this climate: aerosol\.table\.sha256"):
        climate_medium(load(path, wrong).climate, AT_NM)


@pytest.mark.parametrize(
    ("aerosol", "says"),
    [
        ("table: {file: optics.csv}", "column asymmetry is missing"),
        ("table: {file: with_g.csv, phase_function: phase.csv}", "column `asymmetry` is not known"),
        ("table: {file: optics.csv, phase_function: half.csv}", "angle_deg must go from 0 to 180"),
        ("table: {file: narrow.csv}", "wavelength_nm 450 is outside the table, which has 500 to 600 nm"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tables, aerosol, says):
    """A wrong file would not be refused in one sentence."""
    (tables / "half.csv").write_text("wavelength_nm,angle_deg,phase_per_sr\n400,0,1\n400,90,1\n")
    (tables / "narrow.csv").write_text(
        "wavelength_nm,extinction_per_km,single_scattering_albedo,asymmetry\n500,0.1,1,0\n600,0.1,1,0\n"
    )
    with pytest.raises(TwilightError, match=says) as error:
        climate_medium(load_climate(climate(tables, aerosol)), AT_NM)
    assert "\n" not in str(error.value)
