"""Tuned numbers of the zones solver in one table: value, unit, air that it is for, test that covers it, what it does.

A row is NAME: Tuned[type, unit, air, test, what it does and gains] = value; `twilight show solvers zones` prints all
of them (`table`), and with a scene those whose kind of air it has (`grids.kinds_met`).  Numbers that kernels read stand
beside the kernels, where numba sees them change; those of a quality are in `settings`, those that were measured (costs,
errors, limits of what was compared) in `solver`.
"""

import sys
from typing import Annotated as Tuned
from typing import NamedTuple, get_origin

from twilight.base.conventions import UNSEEN

ANY = "any"
COARSE = "dust, sea salt"
VOLCANO = "volcanic layer"
RIM = "top of dust"
THIN = "layer below 2 km thick"
LAYERED = "layered"
CLOUD = "thick cloud"
ICE = "ice crystals"
PARTICLES = "aerosol"
PEAKED = "asymmetry 0.9 and more"
BANDS = "bands of gases"

# fmt: off
# Degrees, directions and harmonics that the air needs.
EARLY_MOMENT: Tuned[float, "1", COARSE, "test_only_coarse_particles_take_more_directions",
    "smallest phase moment of the mixture that needs an azimuthal order of its own in the early orders of scattering; "
    "without, dust is 1 to 2 % off up to 15 deg high below a low sun"] = 0.03
LATE_MOMENT: Tuned[float, "1", COARSE, "test_only_coarse_particles_take_more_directions",
    "smallest phase moment of the mixture that needs a degree in the later orders: 1 to 3 % of the red of deep "
    "twilight"] = 0.1
AZIMUTH_SLACK: Tuned[int, "azimuths", ANY, "test_what_the_air_needs_follows_its_humidity",
    "how many azimuths may be missing before they grow: ordinary air keeps those of its quality"] = 2
LATE_SLACK: Tuned[int, "degrees", ANY, "test_what_the_air_needs_follows_its_humidity",
    "by how much the degree of the later orders may be too low before it grows"] = 1
MAX_PEAK_FRACTION: Tuned[float, "1", COARSE, "test_red_light_beside_a_sun_on_the_horizon_needs_a_higher_degree_in_dust",
    "largest fraction of the scattering that may count as not scattered, in the forward peak; 0.08 makes red light 1 "
    "deg above a sun on the horizon 6 % too dark"] = 0.055
POLAR_MOMENT: Tuned[float, "1", PEAKED, "test_polar_angles_grow_with_the_degree",
    "where the degree grows, polar angles grow with the number of phase moments above this; 14 angles made the zenith "
    "10 % too bright at an asymmetry of 0.9, 32 % at 0.95"] = 0.12
POLAR_GROWTH: Tuned[float, "angles", PEAKED, "test_polar_angles_grow_with_the_degree",
    "polar angles a side for each such moment beyond those of the quality"] = 1.5
LEAST_POLAR_MOMENT: Tuned[float, "1", COARSE, "test_polar_angles_grow_with_the_degree",
    "no more polar angles than phase moments exceed this"] = 0.05
THICK_HAZE_DEPTH: Tuned[float, "optical depth", CLOUD,
    "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "vertical depth of scattering beyond which the degree does not grow: light is nearly isotropic there, and polar "
    "angles for low degrees let through 2 to 3 % less of it with high degrees"] = 5.0
HAZE_DEPTH: Tuned[float, "optical depth", CLOUD, "test_what_the_air_needs_follows_its_humidity",
    "depth from which on the degree grows less and less, up to THICK_HAZE_DEPTH"] = 3.0
ALOFT_KM: Tuned[float, "km", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "altitude from which on particles count as a volcano's"] = 10.0
ALOFT_TAIL_KM: Tuned[float, "km", VOLCANO, "test_haze_that_reaches_up_is_no_volcano",
    "scale height of haze that reaches up to ALOFT_KM from below, whose depth above does not count"] = 2.0
ALOFT_DEPTH: Tuned[float, "optical depth", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "depth of scattering by particles above ALOFT_KM beyond which later orders follow ALOFT_MOMENT: red light of deep "
    "twilight has then been scattered ten times, each time from a line on the horizon"] = 0.04
LEAST_ALOFT_DEPTH: Tuned[float, "optical depth", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "depth from which on they follow smaller and smaller moments, down to ALOFT_MOMENT at ALOFT_DEPTH"] = 0.02
ALOFT_MOMENT: Tuned[float, "1", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "smallest phase moment that needs a degree in the later orders there: 95 % of errors at 680 nm and -18 deg fall "
    "from 11 to 3.2 %"] = 0.024
ALOFT_DEGREE: Tuned[int, "degree", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "degree of the early orders there, up to max_degree; of degree 12 red light is 7 to 9 % too dark at -18 deg, of 20 "
    "no further off than of 28"] = 20
ALOFT_DENSITY: Tuned[float, "1", VOLCANO, "test_later_orders_below_a_volcano_follow_its_peak",
    "factor by which altitude_density grows there, up to 1: nodes further apart make deep twilight 2 to 3 % too "
    "dark"] = 1.4
NEGLIGIBLE_FRACTION: Tuned[float, "1", ANY, "test_ordinary_air_keeps_its_degree",
    "fraction of the largest scattering coefficient below which air does not count"] = 0.01
RIM_KM: Tuned[float, "km", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "altitude from which on a top of haze counts as a rim: lower down the air itself hides what shines behind it"] = 4.0
RIM_DROP_PER_KM: Tuned[float, "1/km", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "drop of the extinction at a rim: a depth of 0.6 over the 200 km that a grazing line has below it"] = 3e-3
RIM_DENSITY: Tuned[float, "1", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "altitude_density from which on rims count: at `draft`, 0.5, they took 1.6 times as long in dust and gained "
    "0.6 % at -18 deg (benchmarks/zones_error.py)"] = 0.65
RIM_POLAR: Tuned[int, "angles", RIM, "test_only_coarse_particles_take_more_directions",
    "more polar angles a side where there is a rim, for the light between it and the horizon"] = 3
BESIDE_KM: Tuned[float, "km", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "distance from an edge at which the extinction is taken on both sides of it"] = 1e-3
THIN_KM: Tuned[float, "km", THIN, "test_a_thin_layer_from_above_and_from_below",
    "thickness, between two sharp edges, below which a layer is thin; one on the ground is none: nothing shines in "
    "from below, nor leaks along it"] = 2.0
THIN_DEPTH: Tuned[float, "optical depth", THIN, "test_a_thin_layer_from_above_and_from_below",
    "depth of scattering from which on a thin layer counts"] = 0.1
THIN_CONTRAST: Tuned[float, "1", THIN, "test_a_thin_layer_from_above_and_from_below",
    "scattering coefficient of a thin layer over those of the layers beside it, at least"] = 1.5
THIN_POLAR: Tuned[int, "angles", THIN, "test_a_thin_layer_from_above_and_from_below",
    "least polar angles a side in the later orders beside one: four below the horizon saw it 6 % too bright from "
    "above"] = 10
DECK_DEPTH: Tuned[float, "optical depth", CLOUD, "test_decks_are_near_doubling_and_adding",
    "vertical depth of scattering, reduced by 1 - g, from which on air is thick, up to SLOW_DEPTH: beyond that of "
    "molecules alone"] = 1.25
DECK_POLAR: Tuned[int, "angles", CLOUD, "test_decks_are_near_doubling_and_adding",
    "least polar angles a side in the later orders there: seven saw a deck of depth 10 4 % too bright from above its "
    "middle, 2 % too dark aslant (benchmarks/clouds.py)"] = 12
THIN_MOMENT: Tuned[float, "1", THIN, "test_light_leaks_along_a_high_layer_after_sunset",
    "smallest phase moment that needs a degree in the later orders where one is above LEAK_KM: with "
    "LATE_MOMENT the zenith is 22 % too dark below one of asymmetry 0.7 at 50 km; below a deck of stratus it "
    "moves nothing by 0.1 %"] = 6e-3
LEAK_KM: Tuned[float, "km", THIN, "test_light_leaks_along_a_high_layer_after_sunset",
    "base of a thin layer from which on the light counts that leaks along it after sunset"] = 6.0
EDGE_FRACTION: Tuned[float, "1", THIN, "test_light_of_a_low_sun_in_a_thin_layer_is_not_stepped_over",
    "distance of the first end of a step from the edge of a thin layer, over the layer's thickness"] = 3e-3
EDGE_GROWTH: Tuned[float, "1", THIN, "test_light_leaks_along_a_high_layer_after_sunset",
    "factor by which ends of steps lie farther and farther from that edge, up to the middle of the layer; with the "
    "usual steps the zenith is 5 % too dark"] = 1.25
LOW_EDGE_GROWTH: Tuned[float, "1", THIN, "test_light_of_a_low_sun_in_a_thin_layer_is_not_stepped_over",
    "the same for layers below LEAK_KM: fewer steps move light below a deck of stratus by 0.05 %"] = 1.8

# Node altitudes.
SMALL_JUMP: Tuned[float, "1", LAYERED, "test_five_hundred_layers_are_the_air_that_they_are_cut_from",
    "largest jump of any coefficient over the extinction there, and of the refractivity, that is taken as a bend: each "
    "jump has a node, and 500 layers of equal mass took more than 70 s"] = 0.05
LOWEST_STEP_KM: Tuned[float, "km", ANY, "test_refinement_converges",
    "interval between node altitudes at the ground, at altitude_density 1"] = 0.12
STEP_GROWTH: Tuned[float, "1", ANY, "test_refinement_converges",
    "growth of that interval with height above the ground"] = 0.21
RIM_STEP_KM: Tuned[float, "km", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "largest interval just above a rim of haze and above jumps higher up, at altitude_density 1: the rim falls away "
    "with the root of the height"] = 0.8
MAX_LOG_EXTINCTION_BEND: Tuned[float, "1", LAYERED, "test_altitudes_are_close_together_where_the_air_is_layered",
    "largest difference, half-way between two nodes, of ln(extinction) from the mean of its values at both"] = 0.15
MAX_INTERVAL_DEPTH: Tuned[float, "optical depth", LAYERED, "test_altitudes_are_close_together_where_the_air_is_layered",
    "largest vertical depth between two nodes"] = 0.12
STRAIGHT_DEPTH: Tuned[float, "optical depth", LAYERED,
    "test_altitudes_grow_apart_slowly_beside_a_layer_and_are_as_they_were_elsewhere",
    "vertical depth between two nodes below which no bend of ln(extinction) matters"] = 1e-3
MAX_HALVINGS: Tuned[int, "1", LAYERED, "test_altitudes_are_close_together_where_the_air_is_layered",
    "how often an interval between nodes is halved at most"] = 14
EDGE_DEPTH: Tuned[float, "optical depth", CLOUD,
    "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "vertical depth above and below a place from which on it is inside thick air"] = 1.0
DEPTH_GROWTH: Tuned[float, "1", CLOUD, "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "growth of MAX_INTERVAL_DEPTH per optical depth inside: light changes as slowly there as its edges are far"] = 1.0
MAX_DEPTH_GROWTH: Tuned[float, "1", CLOUD, "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "largest factor by which it grows: intervals of 7 optical depths lose 3 % of what a cloud of depth 100 lets "
    "through"] = 8.0
MAX_INTERVAL_RATIO: Tuned[float, "1", LAYERED,
    "test_altitudes_grow_apart_slowly_beside_a_layer_and_are_as_they_were_elsewhere",
    "largest ratio of neighbouring intervals: a cubic over 1, 2 and 5 km was 5 to 9 % wrong above a volcanic "
    "layer"] = 2.1
LAYERED_FRACTION: Tuned[float, "1", LAYERED,
    "test_altitudes_grow_apart_slowly_beside_a_layer_and_are_as_they_were_elsewhere",
    "air is layered where an interval was cut to less than this fraction of its length"] = 0.3
FINE_PER_INTERVAL: Tuned[int, "1", ANY, "test_light_under_a_volcanic_layer_has_settled",
    "steps of the fine grids of altitudes and of solar zenith angles in every interval of the nodes"] = 3
MAX_OVERSHOOT: Tuned[float, "1", LAYERED, "test_extreme_air_under_every_sun",
    "largest overshoot of an interpolated logarithm beyond the two nodes around it, over 1 + their difference"] = 0.2

# Polar angles and harmonics.
HORIZON_WIDTH: Tuned[float, "cosine", ANY, "test_few_polar_angles_find_no_harmonics_in_light_that_has_none",
    "distance from the horizon within which polar angles cluster: the light of twilight comes from there"] = 0.03
CENTRE_FRACTION: Tuned[float, "1", ANY, "test_few_polar_angles_find_no_harmonics_in_light_that_has_none",
    "cosine around which the polar angles above the horizon cluster, over the horizon's: from high up the glow is a "
    "line on it"] = 0.75
RIM_WIDTH: Tuned[float, "cosine", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "HORIZON_WIDTH where the glow begins at a rim of haze"] = 0.01
BELOW_RIM: Tuned[int, "angles", RIM, "test_the_top_of_dust_is_a_rim_that_polar_angles_part_at",
    "polar angles between the horizon and a rim; one there makes the red of deep twilight over dust 4 % too dark, two "
    "1.5 %"] = 3
MAX_FITTED_TERMS: Tuned[int, "1", ANY, "test_few_polar_angles_find_no_harmonics_in_light_that_has_none",
    "most terms of the polynomials that are fitted to light away from the horizon (`angles.analysis_rows`)"] = 4
AWAY_COSINE: Tuned[float, "cosine", ANY, "test_few_polar_angles_find_no_harmonics_in_light_that_has_none",
    "distance from the horizon from which on light counts in that fit"] = 0.25
LOW_DEGREE: Tuned[int, "degree", CLOUD, "test_directions_that_keep_energy_lose_no_high_degree",
    "up to which the analysis of conservative scattering is exact: mean, flux, and vertical against horizontal"] = 2

# Solar zenith angles.
TWILIGHT_DEG: Tuned[tuple[float, float], "deg", ANY,
    "test_zenith_nodes_cover_the_range_and_are_closest_at_the_terminator",
    "solar zenith angles between which the field falls by e within a degree, and nodes are closest "
    "together"] = (88.0, 99.0)
TWILIGHT_STEP_DEG: Tuned[float, "deg", ANY, "test_refinement_converges",
    "interval between solar zenith angles there, at zenith_density 1"] = 0.85
DAY_STEP_GROWTH: Tuned[float, "1", ANY, "test_refinement_converges",
    "growth of that interval with the distance from there by day"] = 0.18
MAX_DAY_STEP_DEG: Tuned[float, "deg", ANY, "test_refinement_converges",
    "largest interval by day"] = 12.0
NIGHT_STEP_GROWTH: Tuned[float, "1", ANY, "test_refinement_converges",
    "growth of that interval with the distance from there at night"] = 0.06
MAX_NIGHT_STEP_DEG: Tuned[float, "deg", ANY, "test_deep_night_is_finite_and_darker_and_darker",
    "largest interval at night"] = 6.0
MIN_ZENITH_INTERVALS: Tuned[int, "1", ANY, "test_only_the_zenith_range_that_the_suns_need_is_solved",
    "least intervals of solar zenith angle that a field has"] = 5
LAST_ZENITH_DEG: Tuned[float, "deg", ANY, "test_deep_night_is_finite_and_darker_and_darker",
    "solar zenith angle beyond which the field is taken as it is here: it is then e^-60 of the day's"] = 132.0
MIN_OBSERVER_KM: Tuned[float, "km", ANY, "test_only_the_zenith_range_that_the_suns_need_is_solved",
    "altitude up to which a field for known suns serves all observers, however low the scene's own"] = 12.0
MARGIN_DEG: Tuned[float, "deg", ANY, "test_only_the_zenith_range_that_the_suns_need_is_solved",
    "by how much a field for known suns exceeds what its observers see"] = 2.0
BRIGHT_ZENITH_DEG: Tuned[float, "deg", ANY, "test_only_the_zenith_range_that_the_suns_need_is_solved",
    "air under a sun of this zenith angle or larger is always part of the field: in deep twilight its light "
    "comes far"] = 85.0

# What wavelengths share, and the tables of the sunbeam.
MAX_EXTINCTION_RATIO: Tuned[float, "1", ANY, "test_changed_air_has_grids_of_its_own",
    "extinction over the largest of a range's fixed wavelengths up to which a grid made for those serves"] = 1.5
TERM_FACTORS: Tuned[tuple[float, float], "1", BANDS, "test_neighbours_do_not_move_a_wavelength",
    "multiples of the expected extinction that steps along rays follow for terms of a gas's exponential sum, however "
    "strongly the darkest term absorbs"] = (1.0, 2.0)
ALTITUDE_NODES_PER_SCALE: Tuned[float, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "altitudes of the sunbeam's tables per factor e of the steepest coefficient, at beam_density 1"] = 8.0
LIMB_NODES_PER_SCALE: Tuned[float, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "tangent altitudes of these tables per factor e, at beam_density 1"] = 12.0
COSINE_NODES: Tuned[int, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "intervals of the cosine of the zenith angle, at beam_density 1"] = 40
DISTANCE_NODES: Tuned[int, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "intervals of the distance from the limb, at beam_density 1"] = 12
MIN_DISTANCE_NODES: Tuned[int, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "least such intervals, at any beam_density"] = 8
GUESS_NODES: Tuned[int, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "intervals of the table from which the search for the refracted sun begins, at beam_density 1"] = 48
MIN_SUNLIT_ROWS: Tuned[int, "1", LAYERED, "test_sunlight_between_the_altitudes_of_its_table",
    "least altitudes of the sunlight's table in an interval between the field's nodes"] = 8
MAX_SUNLIT_STEP_KM: Tuned[float, "km", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "largest interval between altitudes of that table at the ground"] = 0.1
SUNLIT_STEP_GROWTH: Tuned[float, "1", ANY, "test_sunlight_between_the_altitudes_of_its_table",
    "growth of that largest interval with height above the ground"] = 0.02
PHASE_NODES: Tuned[int, "1", COARSE, "test_published_stokes_vectors",
    "cosines of the scattering angle, from -1 to 1, at which phase functions of sunlight are tabulated"] = 2049
GEOMETRY_STEPS: Tuned[int, "1", ANY, "test_refinement_converges",
    "geocentric angles at which the solar zenith angle and the azimuth along rays are tabulated"] = 160
SINGLE_DENSITY_FACTOR: Tuned[float, "1", ANY, "test_steps_of_the_first_order_resolve_the_edge_of_the_shadow",
    "density of steps on a line of sight for light scattered once, over that for light scattered more often"] = 1.5
MIN_SINGLE_DENSITY: Tuned[float, "1", ANY, "test_steps_of_the_first_order_resolve_the_edge_of_the_shadow",
    "least density of steps on a line of sight for light scattered once"] = 2.25

# Orders of scattering.
HISTORY: Tuned[int, "steps", CLOUD, "test_thick_conservative_air_is_right_and_solved_in_tens_of_steps",
    "number of steps that are mixed (Anderson)"] = 5
MIN_STEP: Tuned[float, "1", CLOUD, "test_thick_conservative_air_is_right_and_solved_in_tens_of_steps",
    "least mean radiance after a step, over that which one scattering makes of the light before"] = 0.2
POLAR_PER_DEGREE: Tuned[int, "angles", CLOUD, "test_conservative_fog_over_snow_closely",
    "polar angles a side for each degree of the light in thick air of conservative scattering: fewer let through 3 to "
    "5 % too much of it"] = 2
SLOW_DEPTH: Tuned[float, "optical depth", CLOUD,
    "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "vertical depth of scattering, reduced by 1 - g, beyond which all orders are solved at once"] = 2.0
FAINT: Tuned[float, "1/sr", ANY, "test_deep_night_is_finite_and_darker_and_darker",
    "radiance over F0 below which convergence does not matter: a thousandth of a moonless night's own light"] = UNSEEN
FAST_DECAY: Tuned[float, "1", ANY, "test_slow_orders_solved_at_once_are_those_followed_one_by_one",
    "fraction of an order's light left in the next up to which all after the early ones are solved at once; where more "
    "is left, it is known after SETTLED_ORDER whether directions must conserve energy"] = 0.6
CONSERVED_DECAY: Tuned[float, "1", CLOUD, "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "fraction left from which on they must: what a scattering loses adds up"] = 0.85
STEP_TOLERANCE: Tuned[float, "1", ANY, "test_slow_orders_solved_at_once_are_those_followed_one_by_one",
    "largest change of the last step of that solution, over the tolerance: with 0.5 the light of deep twilight over a "
    "town is 0.5 % too dark at draft, with 0.3 0.08 %"] = 0.3
FEW_ORDERS: Tuned[int, "orders", CLOUD, "test_air_thicker_than_was_compared_is_said",
    "largest max_orders that is taken literally: so few are followed one by one, however thick the air"] = 30
SETTLED_ORDER: Tuned[int, "order", CLOUD, "test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps",
    "after which the decay from order to order tells how many will be needed"] = 5
MAX_EARLY_ORDERS: Tuned[int, "orders", CLOUD, "test_air_thicker_than_was_compared_is_said",
    "most that are followed with the directions of the early orders before all others are solved at once"] = 20
STIFF_TOLERANCE: Tuned[float, "1", CLOUD, "test_thick_conservative_air_is_right_and_solved_in_tens_of_steps",
    "largest tolerance of the solution for all orders at once: each of its steps gains a digit"] = 1e-4

# The forward peak.
PEAKED_FRACTIONS: Tuned[tuple[float, float], "1", PEAKED,
    "test_light_beside_a_sharp_peak_does_not_depend_on_the_nodes_of_the_sun",
    "fractions of the scattering in the peak beyond the degree between which solar zenith angles come closer"] = (
    0.1, 0.25)
PEAKED_ZENITHS: Tuned[float, "1", PEAKED,
    "test_light_beside_a_sharp_peak_does_not_depend_on_the_nodes_of_the_sun",
    "growth of the density of solar zenith angles beside a sharp peak: without, a sky of asymmetry 0.95 is 10 % off "
    "15 deg above a sun at 40 deg"] = 2.0
HIGHEST_DEGREE: Tuned[int, "degree", PARTICLES, "test_the_glow_does_not_depend_on_how_much_of_the_peak_is_scaled_away",
    "to which convolutions of the peak are followed; the peak itself is taken from its table"] = 400
MAX_UNRESOLVED: Tuned[float, "1", ICE, "test_peaks_keep_what_the_series_has_left_out",
    "moment of the peak at that degree above which convolutions are followed to ICE_DEGREE"] = 0.1
ICE_DEGREE: Tuned[int, "degree", ICE, "test_peaks_keep_what_the_series_has_left_out",
    "the same beside a peak that is a tenth of a degree wide: with 400 the sky 0.3 to 2 deg from the sun is 8 "
    "% too dark to 7 % too bright; from half of it on terms fade to 0, or the series would end in rings around "
    "the sun"] = 2400
MIN_PEAK_FRACTION: Tuned[float, "1", PARTICLES, "test_air_without_aerosol_has_no_peak",
    "forward fraction f below which an aerosol has no peak"] = 1e-6
STRONG_FRACTION: Tuned[float, "1", PARTICLES, "test_peaks_keep_what_the_series_has_left_out",
    "forward fraction from which on the moments of a peak are taken as they are"] = 0.01
# fmt: on


class TunedNumber(NamedTuple):
    """A row of the table: value in a unit, the air that it is for, a test that covers it, what it does and gains."""

    name: str
    value: float | tuple[float, ...]
    unit: str
    air: str
    test: str
    meaning: str


def table() -> list[TunedNumber]:
    """All tuned numbers, in the sequence of this file."""
    module = sys.modules[__name__]
    rows = []
    for name, annotation in module.__annotations__.items():
        if get_origin(annotation) is Tuned:
            unit, air, test, meaning = annotation.__metadata__
            rows.append(TunedNumber(name, getattr(module, name), unit, air, test, meaning))
    return rows
