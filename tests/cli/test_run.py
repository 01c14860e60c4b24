"""What a run makes of a configuration: the air, the suns, what is left out, and the record."""

import itertools
from datetime import UTC, datetime

import numpy as np
import pytest

import twilight
from twilight.base.errors import TwilightError
from twilight.config import load, load_climate, load_series
from twilight.config.load import shipped
from twilight.engine import run
from twilight.numerics.phase import HENYEY_GREENSTEIN
from twilight.scene import resolve
from twilight.scene.medium import aerosol_spec, climate_medium, ground_albedo, wavelengths_of
from twilight.scene.plan import GAS_TOLERANCE, facts, horizontal_refraction_arcmin, make_plan, scale_height_km
from twilight.scene.scene import resolved_configuration
from twilight.scene.suns import count_suns, suns_of
from twilight.scene.usual import completed

SMALL = {
    "solver": {"name": "zones", "quality": "draft", "max_orders": 1},
    "texture": {"azimuth_count": 8, "elevation_count": 6},
    "sun.elevation_deg": -3,
}


@pytest.mark.parametrize(
    ("climate", "settings", "left_out", "tolerance"),
    [
        ("pure-air", {"gases.ozone.column_du": 0.15, "wavelengths.list_nm": [450]}, "ozone", GAS_TOLERANCE),
        ("pure-air", {"wavelengths": {"list_nm": [800]}}, "no2", 0.0),
        ("pure-air", {"wavelengths": {"list_nm": [500]}}, "o4", 0.0),
        ("urban", {"aerosol.optical_depth_550nm": 0, "wavelengths": {"list_nm": [550]}}, "aerosol", 0.0),
        (
            "pure-air",
            {
                "wavelengths.list_nm": [550],
                "aerosol": {"components": {"waso": 0}, "free_troposphere": False, "stratosphere": "none"},
            },
            "aerosol",
            0.0,
        ),
    ],
)
def test_what_is_left_out_moves_the_sky_by_less_than_stated(climate, settings, left_out, tolerance):
    """Something would be left out that is seen."""
    planned = load(climate, SMALL | settings)
    plan = make_plan(planned)
    assert left_out in [item.part for item in plan.omissions]
    assert plan.climate != planned.climate
    everything = load(climate, SMALL | settings | {"omit_negligible": False})
    assert make_plan(everything).climate == everything.climate
    short, full = (run(resolve(config)).sun_normalised_radiance for config in (planned, everything))
    moved = np.abs(short / full - 1.0).max()
    assert moved <= tolerance + 1e-4  # the grids of `zones` follow the levels of the air
    if tolerance:
        assert moved > 0.0


def test_a_gas_that_matters_stays():
    """A gas or refraction would be left out that is seen."""
    eight = {"wavelengths.count": 8}
    plan = make_plan(load("pure-air", eight))
    gases = load_climate("pure-air").gases
    assert plan.climate.gases == gases.model_copy(update={"oxygen": False})  # no wavelength is in its bands
    assert [item.part for item in plan.omissions] == ["bands of oxygen", "aerosol"]
    assert [item.part for item in make_plan(load("urban", eight)).omissions] == ["bands of oxygen"]
    strong = {"gases.ozone.column_du": 3.0, "wavelengths": {"list_nm": [450]}}
    assert "ozone" not in [item.part for item in make_plan(load("pure-air", strong)).omissions]
    plan = make_plan(load("urban", {"refraction.model": "none", "wavelengths.count": 8}))
    assert [item.part for item in plan.omissions] == ["bands of oxygen", "refraction"]
    assert not climate_medium(plan.climate, np.array([550.0])).has_refraction


def test_eight_placed_wavelengths_give_the_luminance_that_eight_equidistant_ones_miss(coarse_draft):
    """The default wavelengths would miss luminance by 1 %."""
    once = {"solver.max_orders": 1, "solver.quality": "draft", "texture.resolution_deg": 15.0, "sun.elevation_deg": -4}
    once |= {"gases.oxygen": False, "gases.water_vapour.column_mm": 0}
    light = {}
    for name, more in {"fine": {"count": 69}, "placed": {}, "equidistant": {"count": 8}}.items():
        keys = {f"wavelengths.{key}": value for key, value in more.items()}
        config = load("pure-air", {**once, **keys})
        light[name] = run(resolve(config)).luminance()
        parts = [item.part for item in make_plan(config).omissions]
        assert ("other wavelengths" in parts) == (name == "placed")
    worst = {name: np.abs(light[name] / light["fine"] - 1.0).max() for name in ("placed", "equidistant")}
    assert worst["placed"] < 0.01
    assert worst["equidistant"] > 3.0 * worst["placed"]


@pytest.mark.parametrize("name", [*shipped("climates"), *shipped("configs")])
def test_the_record_of_a_frame_is_a_configuration_of_the_same_frame(name):
    """A file's record would be of another frame, or be refused."""
    config = load_series(name)[-1].config
    sun = list(suns_of(config))[-1]
    record = resolved_configuration(config, sun.section)
    again = load(record)
    (same,) = suns_of(again)
    assert resolved_configuration(again, same.section) == record
    assert same.elevation_deg == pytest.approx(sun.elevation_deg, abs=1e-9)
    if config.climate.medium is None:
        assert again.climate == completed(config).climate and again.horizon == completed(config).horizon
    else:  # the record knows what is in the table
        assert again.climate.medium.sha256 and again.climate.medium.table == config.climate.medium.table
    assert np.array_equal(wavelengths_of(again), wavelengths_of(config))
    assert again.texture.shape == config.texture.shape


def test_haber_evening_has_a_frame_every_four_minutes_and_the_sun_goes_down():
    """The paper's evening would have other suns."""
    config = load("saarbruecken-2003-12-08")
    suns = list(suns_of(config))
    assert len(suns) == count_suns(config) == 31
    assert suns[0].time == datetime(2003, 12, 8, 15, 0, tzinfo=UTC) and suns[0].name == "2003-12-08T1600"
    assert suns[-1].time == datetime(2003, 12, 8, 17, 0, tzinfo=UTC)
    elevations = np.array([sun.elevation_deg for sun in suns])
    assert np.all(np.diff(elevations) < 0)
    # Sunset in Saarbruecken on that day was at 16:33 CET, when the true elevation of the centre is -0.83 deg.
    assert abs(np.interp(0.83, -elevations, np.arange(16 * 60, 18 * 60 + 1, 4)) - (16 * 60 + 33)) < 3


def test_steps_of_an_interval_are_even_across_a_change_of_the_clocks():
    """A film would jump by an hour."""
    sun = {"start": "2026-03-29T01:00", "stop": "2026-03-29T04:00", "step_minutes": 30}
    place = {"latitude_deg": 52.5, "longitude_deg": 13.4, "time_zone": "Europe/Berlin"}
    suns = list(suns_of(load("urban", {"sun": sun | place})))
    moments = [s.time.astimezone(UTC) for s in suns]
    assert len(suns) == 5 and len({s.name for s in suns}) == 5
    assert {(b - a).total_seconds() for a, b in itertools.pairwise(moments)} == {1800.0}
    with pytest.raises(TwilightError, match="clocks of Europe/Berlin skip"):
        load("urban", {"sun": {"at": "2026-03-29T02:30"} | place})


def test_a_run_of_several_suns_is_refused_and_says_what_to_use():
    """The first sun would stand for all."""
    with pytest.raises(TwilightError, match=r"3 suns; frames"):
        run(resolve(load("urban", {"sun": {"elevations_deg": [1, 2, 3]}})))


def test_keys_of_the_aerosol_reach_the_medium():
    """A key of the aerosol would do nothing."""
    spec = aerosol_spec(load("desert").climate.aerosol)
    assert spec.boundary_layer_top_km == 6 and spec.scale_height_km == 2
    changed = {
        "aerosol.boundary_layer_top_km": 3,
        "aerosol.scale_height_km": 1.5,
        "aerosol.phase_function": "henyey_greenstein",
        "aerosol.mineral_transported": {"bottom_km": 3, "top_km": 6, "optical_depth_550nm": 0.1},
    }
    spec = aerosol_spec(load("desert", changed).climate.aerosol)
    assert (spec.boundary_layer_top_km, spec.scale_height_km, spec.phase_function) == (3, 1.5, "henyey_greenstein")
    assert spec.mineral_transported.optical_depth_550nm == 0.1
    scaled = load("urban", {"aerosol.optical_depth_550nm": 0.25}).climate
    assert climate_medium(scaled, np.array([550.0])).optical_depth("aerosol") == pytest.approx(0.25, abs=1e-9)


def test_the_stratosphere_is_measured_unless_opac_is_asked_for():
    """A climate would have another stratosphere than its page says."""
    at = np.array([550.0])

    def regions(name, **settings):
        notes = climate_medium(load(name, settings).climate, at).notes
        return {region: (bottom, top) for region, bottom, top in notes["regions"] if region.startswith("strat")}

    assert regions("continental-average") == {"stratosphere (nh_midlat_typical)": (16.5, 100.0)}
    assert list(regions("desert")) == ["stratosphere (tropical_typical)"]
    assert list(regions("antarctic")) == ["stratosphere (sh_midlat_typical)"]
    assert list(regions("volcanic-stratosphere")) == ["stratosphere (high_volcanic)"]
    opac = {"stratosphere": (12.0, 35.0)}
    assert regions("urban", **{"aerosol.stratosphere": "opac"}) == opac
    assert regions("urban", **{"aerosol.stratosphere": "none"}) == {}
    assert regions("urban", **{"aerosol.optical_depth_550nm": 0.0}) == {}
    assert regions("pure-air") == {}
    plain = climate_medium(load("urban", {"aerosol.phase_function": "henyey_greenstein"}).climate, at)
    mie = climate_medium(load("urban").climate, at)
    assert {p.kind for p in plain.phase_functions} == {HENYEY_GREENSTEIN}
    assert [p.asymmetry[0] for p in plain.phase_functions] == pytest.approx(
        [p.asymmetry[0] for p in mie.phase_functions], rel=1e-4
    )


@pytest.mark.parametrize("name", ["urban", "desert"])
def test_air_by_turbidity_and_by_visibility(name):
    """The amount of aerosol would not be what the words mean, or another height or wavelength be meant."""
    at = np.array([450.0, 550.0])

    def told(**settings):
        return dict(facts(climate_medium(load(name, settings).climate, at)))

    by_turbidity = told(**{"aerosol.turbidity": 3.5})
    assert by_turbidity["turbidity at 550 nm (Preetham 1999)"] == "3.50"
    by_visibility = told(**{"aerosol.visibility_km": 20})
    assert by_visibility["visibility at the ground at 550 nm (Koschmieder)"] == "20 km"
    high = {"ground.altitude_km": 1.5, "aerosol.turbidity": 2.5}
    assert told(**high)["turbidity at 550 nm (Preetham 1999)"] == "2.50"


def test_keys_of_gases_layers_and_refraction_reach_the_medium():
    """A key of the air would do nothing, or the ground have another colour than given."""
    at = np.array([600.0])
    medium = climate_medium(load_climate("haber2005-air"), at)
    assert medium.top_km == 35 and np.unique(medium.altitude_km).size == 51
    assert medium.overhead_absorption_optical_depth[0] > 0 and medium.absorption_per_km.max() == 0
    twice = [
        climate_medium(
            load("pure-air", {"gases.ozone.column_du": du, "gases.no2": False, "gases.o4": False}).climate, at
        )
        for du in (200, 400)
    ]
    depths = [m.optical_depth("absorption")[0] for m in twice]
    assert depths[1] / depths[0] == pytest.approx(2.0)
    straight = climate_medium(load("pure-air", {"refraction.model": "none"}).climate, at)
    assert not straight.has_refraction
    boundaries = {"atmosphere.layers.boundaries_km": [0, 1, 10, 100]}
    assert np.unique(climate_medium(load("pure-air", boundaries).climate, at).altitude_km).tolist() == [0, 1, 10, 100]
    ground = load("urban", {"ground.albedo": {"wavelength_nm": [400, 600], "albedo": [0.1, 0.5]}}).climate.ground
    assert ground_albedo(ground, np.array([350.0, 400.0, 500.0, 700.0])) == pytest.approx([0.1, 0.1, 0.3, 0.5])


def test_light_of_a_place_has_the_ozone_of_the_place():
    """Under the ozone hole a sun on the horizon would light the ground by 20 % too little."""
    asked = ((-80.0, 0.0), "2026-10-05T20:00Z", "horizontal", "illuminance", "continental-average")
    usual, same, other = (
        float(twilight.light(*asked, settings=more))
        for more in ({}, {"gases.ozone.column_du": 184.5}, {"gases.ozone.column_du": 323.0})
    )
    assert usual == pytest.approx(same, rel=1e-3) and usual > 1.15 * other


def test_described_ozone_says_where_and_when_it_is_from():
    """`show` would state another ozone than the air has, or impossible refraction and scale height."""

    def ozone(**settings):
        return dict(facts(resolve(load("pure-air", settings)).medium))["ozone column"]

    assert ozone() == "323 DU (zonal mean (McPeters et al. 2007), 45 N, day 197, as midlatitude_summer)"
    assert ozone(**{"gases.ozone.climatology": False}) == "334 DU (AFGL 1986, 45 N, July)"
    placed = {"sun": {"at": "2026-10-05T12:00Z", "latitude_deg": -85.0, "longitude_deg": 0.0}}
    assert ozone(**placed) == "164 DU (zonal mean (McPeters et al. 2007), 85 S, day 278)"
    assert ozone(**{"gases.ozone.column_du": 300}) == "300 DU (as asked for)"
    assert ozone(**{"gases.ozone.day_of_year": 95}) == "370 DU (day 95 of the year, northern midlatitudes)"
    assert ozone(**{"gases.ozone.treatment": "none"}) == "0 DU"
    medium = climate_medium(load_climate("pure-air"), np.array([550.0]))
    assert 29 <= horizontal_refraction_arcmin(medium)[0] <= 35
    assert 8.0 < scale_height_km(medium, "air") < 9.0
    assert np.isnan(scale_height_km(medium, "aerosol"))
