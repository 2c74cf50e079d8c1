"""The pneumatic arm as a whole."""

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from drivers.pose import rotate
from sim_backends.plants import rod_kernels
from sim_backends.plants.plant import (
    GRAVITY_N_G,
    BodyState,
    FloatArray,
    Plant,
    PlantError,
    TipLoad,
    variation,
)
from sim_backends.plants.shooting import warm_up
from sim_backends.plants.soft_arm.gas import ATMOSPHERE_MPA
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.sim_backends.plants.rods import equilibrium

PAPER = SoftArmPlant(kind="soft_arm")
STATIC = PAPER.model_copy(update={"hysteresis": 0.0, "creep": 0.0})
PISTON_MM2 = np.pi / 4.0 * 25.0**2
STROKE_MM = 50.0
PERIOD_S = 0.025
LONG_S = 1e6
FREE = TipLoad()


def built(plant: SoftArmPlant = PAPER) -> SoftArm:
    return SoftArm(plant, [PISTON_MM2] * 6)


def moved(
    arm: SoftArm, actuators: list[float] | FloatArray, load: TipLoad = FREE, dt_s: float = PERIOD_S
) -> BodyState:
    return arm.step(np.asarray(actuators, dtype=np.float64), load, dt_s)


def settled(
    plant: SoftArmPlant, actuators: list[float] | FloatArray, load: TipLoad = FREE
) -> BodyState:
    return moved(built(plant), actuators, load, LONG_S)


def random_walk(seed: int, steps: int) -> FloatArray:
    """(steps, 6) positions on straight lines between random places, 0.25 mm a step at most."""
    generator = np.random.default_rng(seed)
    places: list[FloatArray] = []
    here = np.zeros(6)
    while len(places) < steps:
        goal = generator.uniform(0.0, STROKE_MM, 6)
        count = int(np.ceil(np.abs(goal - here).max() / 0.25))
        places.extend(here + (goal - here) * k / count for k in range(1, count + 1))
        here = goal
    return np.array(places[:steps])


def direction(quaternion: FloatArray) -> FloatArray:
    return rotate(quaternion, np.array([0.0, 0.0, 1.0]))


def test_it_is_a_plant_of_six_actuators() -> None:
    plant: Plant = built()
    assert plant.actuator_count == 6


def test_left_alone_it_stands_straight_under_its_pre_pressure() -> None:
    arm = built()
    state = moved(arm, [0.0] * 6)
    stretch = (3 * 0.04 * PAPER.chamber_area_mm2 - 0.5 * GRAVITY_N_G * PAPER.mass_g) / 130.0
    np.testing.assert_allclose(state.tip.position_mm, [0, 0, 155 * (1 + stretch)], atol=1e-6)
    np.testing.assert_allclose(state.tip.quaternion, [1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(arm.chamber_pressure_mpa, ATMOSPHERE_MPA + 0.04, rtol=1e-9)


def test_a_piston_feels_the_gauge_pressure_on_its_bore_pushing_it_back() -> None:
    at_rest = moved(built(), [0.0] * 6).actuator_forces
    np.testing.assert_allclose(at_rest, 0.04 * PISTON_MM2, rtol=1e-9)
    pushed = settled(PAPER, [20.0, 0, 0, 0, 0, 0]).actuator_forces
    assert pushed[0] > 2 * at_rest[0]


def test_rest_lasts() -> None:
    arm = built()
    first = moved(arm, [0.0] * 6).centreline_mm
    for _ in range(50):
        last = moved(arm, [0.0] * 6).centreline_mm
    np.testing.assert_allclose(first, last, atol=1e-7)


@pytest.mark.parametrize("pushed", [(0,), (0, 1), (3,), (4, 5)])
def test_every_segment_bends_by_about_100_degrees_within_the_stroke(
    pushed: tuple[int, ...],
) -> None:
    """The paper's figure, with pressures that silicone stands."""
    arm = built()
    actuators = np.zeros(6)
    actuators[list(pushed)] = STROKE_MM
    state = moved(arm, actuators, FREE, LONG_S)
    angle = np.degrees(np.arccos(direction(state.tip.quaternion)[2]))
    assert 85.0 < angle < 115.0
    assert (arm.chamber_pressure_mpa - ATMOSPHERE_MPA).max() < 0.3


def test_a_chamber_that_is_pushed_bends_the_arm_away_from_it() -> None:
    tip = settled(PAPER, [15.0, 0, 0, 0, 0, 0]).tip.position_mm
    assert tip[0] < -10.0
    assert abs(tip[1]) < 1e-6


def test_turning_the_actuation_by_120_degrees_turns_the_shape() -> None:
    actuators, load = np.array([30.0, 5.0, 0.0, 12.0, 0.0, 25.0]), TipLoad(14.2)
    turned = np.concatenate([np.roll(actuators[:3], 1), np.roll(actuators[3:], 1)])
    third = np.array([0.5, 0.0, 0.0, np.sqrt(0.75)])
    before, after = (settled(PAPER, a, load).centreline_mm for a in (actuators, turned))
    np.testing.assert_allclose(after, [rotate(third, p) for p in before], atol=1e-5)


def test_the_enclosed_gas_is_kept_through_any_motion() -> None:
    arm = built()
    walk = random_walk(3, 300)
    supply = 1e3 * (PAPER.cylinder_volume_ml + PAPER.tube_volume_ml)
    amount = (ATMOSPHERE_MPA + 0.04) * (supply + PAPER.chamber_area_mm2 * arm.chamber_length_mm)
    piston = PISTON_MM2
    for k, actuators in enumerate(walk):
        state = moved(arm, actuators, TipLoad(20.0 if k > 150 else 0.0))
        in_cylinder = (state.actuator_forces / piston + ATMOSPHERE_MPA) * (
            supply - piston * actuators
        )
        volume = PAPER.chamber_area_mm2 * arm.chamber_length_mm
        np.testing.assert_allclose(
            in_cylinder + arm.chamber_pressure_mpa * volume, amount, rtol=1e-9
        )


def test_a_load_changes_the_pressures_and_the_drives_feel_it() -> None:
    upright = [settled(PAPER, [10.0] * 6, TipLoad(g)).actuator_forces for g in (0.0, 30.0)]
    assert (upright[1] > upright[0] + 0.02).all(), "it presses on every chamber"
    bent = [settled(PAPER, [25.0, 0, 0, 0, 0, 0], TipLoad(g)).actuator_forces for g in (0.0, 30.0)]
    assert bent[1][0] < bent[0][0] - 0.1, "it bends further and draws the pushed chamber out"
    assert (bent[1][1:3] > bent[0][1:3] + 0.1).all(), "and presses on the other two"


def test_volume_driven_it_is_stiffer_than_pressure_driven() -> None:
    arm = built(STATIC)
    free = moved(arm, [25.0, 0, 0, 0, 0, 0], FREE, LONG_S).tip.position_mm
    pull = arm._memory.equilibrium.pull_n
    heavy = moved(arm, [25.0, 0, 0, 0, 0, 0], TipLoad(14.2), LONG_S).tip.position_mm
    weight = np.array([0.0, 0.0, -GRAVITY_N_G])
    held = equilibrium(arm._rod, pull, 14.2 * weight, PAPER.mass_g * weight)
    at_same_pressure = held.march.position_mm[-1]
    assert 1.03 * np.linalg.norm(heavy - free) < np.linalg.norm(at_same_pressure - free)


def test_a_heavier_load_bends_it_further_and_the_gain_grows() -> None:
    tips, gains = [], []
    for grams in (0.0, 14.2, 24.0, 30.0):
        near, far = (
            settled(STATIC, [15.0 + d, 0, 0, 8.0, 0, 0], TipLoad(grams)).tip.position_mm
            for d in (0.0, 0.5)
        )
        tips.append(near[2])
        gains.append(np.linalg.norm(far - near))
    assert (np.diff(tips) < 0).all()
    assert (np.diff(gains) > 0).all()
    assert gains[-1] > 1.3 * gains[0], "towards its buckling load it gets softer"


def test_a_mass_is_a_force_straight_down() -> None:
    actuators = [20.0, 3.0, 0, 0, 15.0, 0]
    mass = settled(PAPER, actuators, TipLoad(mass_g=20.0))
    force = settled(PAPER, actuators, TipLoad(force_n=(0.0, 0.0, -20.0 * GRAVITY_N_G)))
    np.testing.assert_allclose(mass.centreline_mm, force.centreline_mm, atol=1e-9)


def test_past_its_buckling_load_it_ends_bent() -> None:
    arm = built(STATIC)
    upright = moved(arm, [0.0] * 6, TipLoad(30.0), LONG_S).tip.position_mm
    assert np.linalg.norm(upright[:2]) < 1e-6
    fallen = moved(arm, [0.0] * 6, TipLoad(130.0), LONG_S).tip.position_mm
    assert np.linalg.norm(fallen[:2]) > 50.0
    again = moved(arm, [0.0] * 6, FREE, LONG_S).tip.position_mm
    assert np.linalg.norm(again[:2]) < 1e-3


def test_a_load_may_change_while_it_moves() -> None:
    """Filled while moving (14 to 24 to 30 g), it passes through the states of a slow filling."""
    arm, walk = built(), random_walk(5, 400)
    grams = np.interp(np.arange(400), [100, 200, 250, 300], [14.0, 24.0, 24.0, 30.0])
    before = None
    for actuators, mass in zip(walk, grams, strict=True):
        tip = moved(arm, actuators, TipLoad(float(mass))).tip.position_mm
        assert before is None or np.linalg.norm(tip - before) < 4.0, "no jump"
        before = tip
    dropped = moved(arm, walk[-1], TipLoad(0.0)).tip.position_mm
    assert before is not None
    assert dropped[2] > before[2]


def test_pressures_follow_the_pistons_with_the_lag() -> None:
    arm = built(STATIC)
    moved(arm, [0.0] * 6)
    start = arm.chamber_pressure_mpa[0]
    course = []
    for _ in range(200):
        moved(arm, [20.0, 0, 0, 0, 0, 0], FREE, 0.005)
        course.append(arm.chamber_pressure_mpa[0])
    left = (course[-1] - np.array(course)) / (course[-1] - start)
    time_s = 0.005 * (1 + int(np.argmax(left < np.exp(-1.0))))
    assert 0.08 < time_s < 0.16, "the lag of 0.1 s, a little longer as the chamber grows"


def test_it_creeps_by_its_share_in_its_time() -> None:
    plant = PAPER.model_copy(update={"hysteresis": 0.0, "pneumatic_lag_s": 1e-3})
    arm = built(plant)
    actuators = [20.0, 0, 0, 0, 0, 0]
    course = [moved(arm, actuators, FREE, 0.5).tip.position_mm[0] for _ in range(400)]
    late = (course[-1] - np.array(course)) / (course[-1] - course[0])
    assert 0.01 < (course[-1] - course[0]) / course[-1] < 0.06
    assert 15.0 < 0.5 * int(np.argmax(late < np.exp(-1.0))) < 25.0


def test_the_way_back_is_another_one_and_slowness_does_not_close_the_gap() -> None:
    plant = PAPER.model_copy(update={"creep": 0.0})
    widths = []
    for dt_s in (1.0, 100.0):
        arm, ways = built(plant), []
        for positions in (range(31), range(30, -1, -1)):
            tips = [moved(arm, [float(p), 0, 0, 0, 0, 0], FREE, dt_s).tip for p in positions]
            ways.append(np.array([tip.position_mm[0] for tip in tips]))
        widths.append(np.abs(ways[0] - ways[1][::-1]).max())
    assert widths[0] > 2.0
    assert widths[1] == pytest.approx(widths[0], rel=1e-3)


def test_without_hysteresis_creep_and_time_the_way_does_not_matter() -> None:
    arm, goal = built(STATIC), [20.0, 5.0, 0.0, 0.0, 12.0, 3.0]
    for actuators in random_walk(8, 60):
        moved(arm, actuators, TipLoad(20.0))
    there = moved(arm, goal, TipLoad(5.0), LONG_S).centreline_mm
    np.testing.assert_allclose(there, settled(STATIC, goal, TipLoad(5.0)).centreline_mm, atol=1e-5)


def test_the_same_inputs_give_the_same_outputs_to_the_last_bit() -> None:
    arm, other, walk = built(), built(), random_walk(1, 150)
    runs = []
    for plant in (arm, arm, other):
        plant.reset()
        runs.append([moved(plant, a, TipLoad(10.0)) for a in walk])
    for first, second, third in zip(*runs, strict=True):
        assert first.centreline_mm.tobytes() == second.centreline_mm.tobytes()
        assert first.centreline_mm.tobytes() == third.centreline_mm.tobytes()
        assert first.actuator_forces.tobytes() == third.actuator_forces.tobytes()


BAD_STEPS = {
    "a position that is no number": ([np.nan, 0, 0, 0, 0, 0], FREE, PERIOD_S),
    "an infinite position": ([0, 0, np.inf, 0, 0, 0], FREE, PERIOD_S),
    "a piston through the bottom": ([60.0, 0, 0, 0, 0, 0], FREE, PERIOD_S),
    "a piston pulled out": ([0, -60.0, 0, 0, 0, 0], FREE, PERIOD_S),
    "a huge position": ([0, 0, 0, 0, 1e308, 0], FREE, PERIOD_S),
    "too few actuators": ([0, 0, 0], FREE, PERIOD_S),
    "a load that is no number": ([0] * 6, TipLoad(np.nan), PERIOD_S),
    "a negative mass": ([0] * 6, TipLoad(-1.0), PERIOD_S),
    "a huge mass": ([0] * 6, TipLoad(1e308), PERIOD_S),
    "an infinite force": ([0] * 6, TipLoad(0.0, (0.0, -np.inf, 0.0)), PERIOD_S),
    "a force that tears it": ([0] * 6, TipLoad(0.0, (0.0, 0.0, 500.0)), PERIOD_S),
    "time that runs back": ([0] * 6, FREE, -0.1),
    "time that is no number": ([0] * 6, FREE, np.nan),
    "endless time": ([0] * 6, FREE, np.inf),
}


@pytest.mark.parametrize("bad", BAD_STEPS.values(), ids=BAD_STEPS.keys())
def test_what_makes_no_sense_is_refused_and_changes_nothing(
    bad: tuple[list[float], TipLoad, float],
) -> None:
    arm, twin, walk = built(), built(), random_walk(2, 40)
    for actuators in walk[:20]:
        moved(arm, actuators)
        moved(twin, actuators)
    with pytest.raises(PlantError):
        moved(arm, *bad)
    for actuators in walk[20:]:
        after, expected = moved(arm, actuators), moved(twin, actuators)
        assert after.centreline_mm.tobytes() == expected.centreline_mm.tobytes()


def test_an_error_says_at_which_actuation_and_load() -> None:
    with pytest.raises(PlantError, match=r"\[1, 2, 3, 4, 5, 6\] mm with 9000 g and \[0, 0, 0\] N"):
        moved(built(), [1, 2, 3, 4, 5, 6], TipLoad(9000.0))
    for place in (70, np.nan):
        with pytest.raises(PlantError, match=rf"actuator 4 cannot be at {place} mm"):
            moved(built(), [0, 0, 0, 0, place, 0])


def test_what_it_returned_is_not_changed_by_what_follows() -> None:
    arm = built()
    state = moved(arm, [5.0] * 6)
    kept = state.centreline_mm.copy()
    state.centreline_mm[:] = -1.0
    moved(arm, [8.0, 0, 0, 0, 0, 0])
    again = built()
    np.testing.assert_array_equal(moved(again, [5.0] * 6).centreline_mm, kept)


@pytest.mark.parametrize("grams", [0.0, 14.2, 32.0])
def test_jumps_over_the_whole_workspace_are_solved_under_every_load_of_the_paper(
    grams: float,
) -> None:
    arm, generator = built(), np.random.default_rng(7)
    for _ in range(150):
        dt_s = float(generator.choice([0.0, PERIOD_S, 1.0, LONG_S]))
        state = moved(arm, generator.uniform(0, STROKE_MM, 6), TipLoad(grams), dt_s)
        assert np.isfinite(state.centreline_mm).all()
        assert np.isfinite(state.actuator_forces).all()
        assert np.linalg.norm(state.tip.quaternion) == pytest.approx(1.0)


def test_thirty_times_the_load_of_the_paper_leaves_it_hanging_somewhere() -> None:
    """Far past its buckling load, from one extreme of the actuators to another."""
    arm, generator = built(), np.random.default_rng(6)
    for _ in range(32):
        actuators = generator.uniform(0, STROKE_MM, 6)
        state = moved(arm, actuators, TipLoad(float(generator.uniform(0, 1000))))
        assert np.isfinite(state.centreline_mm).all()


def test_it_needs_one_piston_per_chamber() -> None:
    with pytest.raises(ValueError, match="6 pistons"):
        SoftArm(PAPER, [16.0] * 5)


def test_a_larger_piston_bends_it_further() -> None:
    small, large = (SoftArm(PAPER, [np.pi / 4.0 * bore**2] * 6) for bore in (16.0, 25.0))
    tips = [
        moved(arm, [15.0, 0, 0, 0, 0, 0], FREE, LONG_S).tip.position_mm[0] for arm in (small, large)
    ]
    assert tips[1] < tips[0] < 0


def test_variations_are_other_arms_of_the_same_design() -> None:
    arms = [variation(PAPER, seed) for seed in range(30)]
    assert arms[4] == variation(PAPER, 4)
    assert len({arm.bending_stiffness_n_mm2 for arm in arms}) == 30
    stiffness = [arm.bending_stiffness_n_mm2 / PAPER.bending_stiffness_n_mm2 for arm in arms]
    assert 0.9 <= min(stiffness) < 0.95 < 1.05 < max(stiffness) <= 1.1
    axial = [arm.axial_stiffness_n / PAPER.axial_stiffness_n for arm in arms]
    assert axial == pytest.approx(stiffness), "one batch of silicone"
    assert all(len(set(arm.chamber_area_ratios)) == 6 for arm in arms)


def test_every_variation_stands_and_moves_under_30_g() -> None:
    for seed in range(8):
        arm = built(variation(PAPER, seed))
        rest = moved(arm, [0.0] * 6).tip.position_mm
        assert np.linalg.norm(rest[:2]) < 15.0
        for actuators in random_walk(seed, 60):
            moved(arm, actuators, TipLoad(30.0))


def test_no_kernel_is_compiled_again_while_the_arm_moves() -> None:
    """A second signature would cost seconds in the middle of the loop."""
    warm_up()
    arm = built()
    for actuators in random_walk(4, 50):
        moved(arm, actuators, TipLoad(30.0))
    moved(arm, [0.0] * 6, TipLoad(150.0))
    for kernel in (
        rod_kernels.march,
        rod_kernels.tangent,
        rod_kernels.unstable_directions,
        rod_kernels.newton_step,
        rod_kernels.broyden,
        rod_kernels.settle_chambers,
    ):
        assert len(kernel.signatures) == 1, kernel
