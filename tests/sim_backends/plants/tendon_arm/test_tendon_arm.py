"""The tendon-driven arm as a body: what tendons, weight and loads do to it."""

import numpy as np
import pytest

from drivers.pose import rotate
from sim_backends.plants import rod_kernels
from sim_backends.plants.plant import GRAVITY_N_G, FloatArray, Plant, PlantError, TipLoad
from sim_backends.plants.tendon_arm import statics_kernels as tendon_arm_kernels
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm, variation
from tests.sim_backends.plants.tendon_arms import (
    FREE,
    PERIOD_S,
    SHIPPED,
    SMOOTH,
    bend,
    led,
    moved,
    paid_out,
    plant,
    walk,
    with_tendons,
)

STRAIGHT = ((0.0, 0.0), (2 * np.pi / 3, 0.0), (-2 * np.pi / 3, 0.0))
AT_REST = np.zeros(4)


def twist(quaternion: FloatArray) -> float:
    """Turn about the z axis, rad, of a frame that is hardly bent."""
    return float(2.0 * np.arctan2(quaternion[3], quaternion[0]))


def test_it_is_a_plant_with_one_actuator_per_tendon() -> None:
    arm: Plant = TendonArm(SHIPPED)
    assert arm.actuator_count == 4


def test_even_straight_tendons_leave_it_straight_and_press_it_together() -> None:
    config = with_tendons(*STRAIGHT, mass_g=30.0)
    arm = TendonArm(config)
    before = moved(arm, [0.0] * 3).tip.position_mm
    after = moved(arm, [1.0] * 3).tip
    np.testing.assert_allclose(after.quaternion, [1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(after.position_mm[:2], 0.0, atol=1e-6)
    tension = arm.tension_n[0]
    assert (tension > 1.2 * config.pretension_n).all()
    shortened = 3 * (tension[0] - config.pretension_n) / config.axial_stiffness_n * 200.0
    assert before[2] - after.position_mm[2] == pytest.approx(shortened, rel=1e-6)


def test_at_rest_every_tendon_has_its_pretension() -> None:
    arm = TendonArm(SHIPPED)
    state = moved(arm, AT_REST)
    np.testing.assert_allclose(arm.tension_n, SHIPPED.pretension_n, rtol=1e-5)
    np.testing.assert_allclose(state.actuator_forces, SHIPPED.pretension_n, rtol=1e-5)


def test_rest_lasts() -> None:
    arm = TendonArm(SHIPPED)
    led(arm, AT_REST, bend(3.0, 1.0, 2.0))
    first = moved(arm, bend(3.0, 1.0, 2.0)).centreline_mm
    for _ in range(30):
        last = moved(arm, bend(3.0, 1.0, 2.0)).centreline_mm
    np.testing.assert_allclose(last, first, atol=1e-7)


def test_one_straight_tendon_bends_it_into_a_circle_as_far_as_it_is_wound() -> None:
    """T = P + d / (1/k + L/EA_tendon + L/EA + L ρ²/EI), and then curvature T ρ/EI all along."""
    c = with_tendons((0.0, 0.0))
    length, radius = c.length_mm, c.tendon_radius_mm
    give = (
        1.0 / c.drive_stiffness_n_mm
        + length / c.tendon_stiffness_n
        + length / c.axial_stiffness_n
        + length * radius**2 / c.bending_stiffness_n_mm2
    )
    for wound_mm in (-3.0, 2.0, 9.0):
        arm = TendonArm(c)
        tip = moved(arm, [wound_mm]).tip
        tension = c.pretension_n + wound_mm / give
        np.testing.assert_allclose(arm.tension_n[:, 0], tension, rtol=1e-3)
        curvature = tension * radius / c.bending_stiffness_n_mm2
        stretch, angle = 1.0 - tension / c.axial_stiffness_n, curvature * length
        expected = stretch / curvature * np.array([1.0 - np.cos(angle), 0.0, np.sin(angle)])
        np.testing.assert_allclose(tip.position_mm, expected, atol=0.02)


def test_a_winding_tendon_twists_it() -> None:
    """A newton along the tangent turns by ρ times its share across the axis."""
    c = with_tendons((0.0, -1.5), pretension_n=0.02)
    turn = -3 * np.pi / c.length_mm
    slope = c.tendon_radius_mm * turn / np.hypot(1.0, c.tendon_radius_mm * turn)
    per_newton = -c.tendon_radius_mm * slope * c.length_mm / c.torsion_stiffness_n_mm2
    arm = TendonArm(c)
    before = twist(moved(arm, [0.0]).tip.quaternion)
    after = twist(moved(arm, [0.02]).tip.quaternion)
    newtons = arm.tension_n[0, 0] - c.pretension_n
    assert (after - before) / newtons == pytest.approx(per_newton, rel=0.02)
    assert per_newton > 0.1, "rad: it is wound the other way"


def test_turning_the_pull_by_120_degrees_turns_the_shape() -> None:
    config = with_tendons(*STRAIGHT, mass_g=30.0, friction=0.2)
    pulls = np.array([3.0, 0.5, -1.0])
    third = np.array([0.5, 0.0, 0.0, np.sqrt(0.75)])
    before = moved(TendonArm(config), pulls, TipLoad(20.0)).centreline_mm
    after = moved(TendonArm(config), np.roll(pulls, 1), TipLoad(20.0)).centreline_mm
    np.testing.assert_allclose(after, [rotate(third, p) for p in before], atol=1e-5)


def test_a_millimetre_moves_the_tip_by_half_the_length_over_the_tendons_radius() -> None:
    """Where tendons do not stretch: 12.5 mm; with this drive train a little less."""
    stiff = with_tendons(*STRAIGHT, drive_stiffness_n_mm=1e4, tendon_stiffness_n=1e7)
    soft = with_tendons(*STRAIGHT)
    for config, lowest, highest in ((stiff, 12.4, 12.6), (soft, 11.0, 12.3)):
        arm = TendonArm(config)
        before = moved(arm, [0.0] * 3).tip.position_mm
        after = moved(arm, bend(0.1)[:3]).tip.position_mm
        assert lowest < (after - before)[0] / 0.1 < highest


def test_a_slack_tendon_does_not_push() -> None:
    arm = TendonArm(SHIPPED)
    led(arm, AT_REST, bend(-6.0))
    motors = bend(-6.0)
    motors[0] -= 2.0
    slack = led(arm, bend(-6.0), motors)
    assert arm.tension_n[:, 0].min() >= 0.0
    assert arm.tension_n[:, 0].max() < 1e-3
    further = motors.copy()
    further[0] -= 5.0
    more = led(arm, motors, further)
    assert arm.tension_n[:, 0].min() >= 0.0
    np.testing.assert_allclose(more.centreline_mm, slack.centreline_mm, atol=5e-3)


def test_the_drives_feel_the_tension_and_a_stiffer_arm_pulls_harder() -> None:
    forces = []
    for factor in (1.0, 2.0):
        config = plant(
            friction=0.0,
            bending_stiffness_n_mm2=factor * SHIPPED.bending_stiffness_n_mm2,
        )
        arm = TendonArm(config)
        forces.append(led(arm, AT_REST, bend(4.0)).actuator_forces)
        np.testing.assert_array_equal(forces[-1], arm.tension_n[0])
    assert forces[1][0] > forces[0][0] + 0.5
    assert forces[0][0] > SHIPPED.pretension_n > forces[0][1]


def test_a_push_at_the_tip_bends_it_tightens_one_side_and_slackens_the_other() -> None:
    arm = TendonArm(SHIPPED)
    free = moved(arm, AT_REST).tip.position_mm
    deflections = []
    for newtons in (0.05, 0.1, 0.2, 0.4):
        arm.reset()
        tip = moved(arm, AT_REST, TipLoad(force_n=(newtons, 0.0, 0.0))).tip.position_mm
        deflections.append(tip[0] - free[0])
        assert arm.tension_n[0, 0] < SHIPPED.pretension_n < arm.tension_n[0, 1:3].min()
    assert (np.diff([0.0, *deflections]) > 2.0).all()


def test_weight_pulls_it_down_wherever_down_is() -> None:
    hanging = moved(TendonArm(SMOOTH), AT_REST, TipLoad(100.0)).tip.position_mm
    free = moved(TendonArm(SMOOTH), AT_REST).tip.position_mm
    assert hanging[2] > free[2] + 0.01
    level = plant(friction=0.0, gravity_direction=(0.0, -2.0, 0.0))
    sagged = [
        moved(TendonArm(level), AT_REST, TipLoad(grams)).tip.position_mm[1] for grams in (0, 10, 20)
    ]
    assert (np.diff(sagged) < -2.0).all()


def test_held_by_slack_tendons_only_it_sags_as_a_cantilever_does() -> None:
    """w L³ / 8 EI with two ends of tendons that cannot hold anything."""
    config = with_tendons(
        (np.pi / 2, 0.0), mass_g=0.5, gravity_direction=(1.0, 0.0, 0.0), pretension_n=0.001
    )
    sag = moved(TendonArm(config), [-20.0]).tip.position_mm[0]
    weight = GRAVITY_N_G * config.mass_g
    bending = weight * config.length_mm**3 / (8 * config.bending_stiffness_n_mm2)
    shear = weight * config.length_mm / (2 * config.shear_stiffness_n)
    assert sag == pytest.approx(bending + shear, rel=1e-3)


def test_a_mass_is_a_force_along_gravity() -> None:
    motors = bend(4.0, 0.7, 2.0)
    mass = moved(TendonArm(SHIPPED), motors, TipLoad(mass_g=30.0))
    force = moved(TendonArm(SHIPPED), motors, TipLoad(force_n=(0.0, 0.0, 30.0 * GRAVITY_N_G)))
    np.testing.assert_allclose(mass.centreline_mm, force.centreline_mm, atol=1e-9)


def test_no_work_is_won_or_lost_on_a_round_trip_without_friction() -> None:
    assert abs(work_of_a_round_trip(0.0)) < 2e-4


def test_friction_takes_work_on_every_round_trip() -> None:
    assert 0.05 < work_of_a_round_trip(0.1) < work_of_a_round_trip(0.3) < 10.0


def work_of_a_round_trip(friction: float) -> float:
    """N·mm that the motors put in, from a corner over two others and back, the second time."""
    arm = TendonArm(plant(friction=friction, backlash_mm=0.0))
    corners = [bend(2.5, 0.0, 1.0), bend(3.0, 2.0, -0.5), bend(1.0, -2.0, 2.0)]
    led(arm, AT_REST, corners[-1])
    for _ in range(2):
        work, here = 0.0, corners[-1]
        for corner in corners:
            for k in range(1, 31):
                before = arm.tension_n[0]
                moved(arm, here + (corner - here) * k / 30)
                work += 0.5 * float((before + arm.tension_n[0]) @ (corner - here)) / 30
            here = corner
    return work


def test_the_centreline_is_the_body_and_has_its_radius() -> None:
    state = led(TendonArm(SHIPPED), AT_REST, bend(5.0, 1.0, 3.0))
    line = state.centreline_mm
    np.testing.assert_array_equal(line[0], 0.0)
    np.testing.assert_array_equal(line[-1], state.tip.position_mm)
    spacing = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert 190.0 < spacing.sum() < 200.5
    assert spacing.max() < state.radius_mm == SHIPPED.body_radius_mm


@pytest.mark.parametrize("grams", [0.0, 30.0])
def test_the_tip_is_right_to_a_few_micrometres_along_any_way(grams: float) -> None:
    """Against eight times as many intervals, with all that friction makes of the way."""
    arm, exact = TendonArm(SHIPPED), TendonArm(SHIPPED, intervals_per_span=16)
    generator, here = np.random.default_rng(3), AT_REST
    for _ in range(4):
        goal = paid_out(generator)
        coarse = led(arm, here, goal, TipLoad(grams))
        fine = led(exact, here, goal, TipLoad(grams))
        assert np.linalg.norm(coarse.tip.position_mm - fine.tip.position_mm) < 5e-3
        here = goal


def test_the_same_inputs_give_the_same_outputs_to_the_last_bit() -> None:
    arm, other, places = TendonArm(SHIPPED), TendonArm(SHIPPED), walk(1, 120)
    runs = []
    for one in (arm, arm, other):
        one.reset()
        runs.append([moved(one, place, TipLoad(10.0)) for place in places])
    for first, second, third in zip(*runs, strict=True):
        assert first.centreline_mm.tobytes() == second.centreline_mm.tobytes()
        assert first.centreline_mm.tobytes() == third.centreline_mm.tobytes()
        assert first.actuator_forces.tobytes() == third.actuator_forces.tobytes()


BAD_STEPS = {
    "a position that is no number": ([np.nan, 0, 0, 0], FREE, PERIOD_S),
    "an infinite position": ([0, 0, np.inf, 0], FREE, PERIOD_S),
    "more tendon than there is": ([250.0, 0, 0, 0], FREE, PERIOD_S),
    "too few actuators": ([0, 0, 0], FREE, PERIOD_S),
    "a load that is no number": ([0] * 4, TipLoad(np.nan), PERIOD_S),
    "a negative mass": ([0] * 4, TipLoad(-1.0), PERIOD_S),
    "an infinite force": ([0] * 4, TipLoad(0.0, (0.0, -np.inf, 0.0)), PERIOD_S),
    "a force that tears it": ([0] * 4, TipLoad(0.0, (0.0, 0.0, 5000.0)), PERIOD_S),
    "time that runs back": ([0] * 4, FREE, -0.1),
    "time that is no number": ([0] * 4, FREE, np.nan),
    "endless time": ([0] * 4, FREE, np.inf),
}


@pytest.mark.parametrize("bad", BAD_STEPS.values(), ids=BAD_STEPS.keys())
def test_what_makes_no_sense_is_refused_and_changes_nothing(
    bad: tuple[list[float], TipLoad, float],
) -> None:
    arm, twin, places = TendonArm(SHIPPED), TendonArm(SHIPPED), walk(2, 20)
    for place in places[:10]:
        moved(arm, place)
        moved(twin, place)
    with pytest.raises(PlantError):
        moved(arm, *bad)
    for place in places[10:]:
        after, expected = moved(arm, place), moved(twin, place)
        assert after.centreline_mm.tobytes() == expected.centreline_mm.tobytes()


def test_an_error_says_which_actuator() -> None:
    for place in (300, np.nan):
        with pytest.raises(PlantError, match=rf"actuator 2 cannot be at {place} mm"):
            moved(TendonArm(SHIPPED), [0, 0, place, 0])


def test_what_it_returned_is_not_changed_by_what_follows() -> None:
    arm = TendonArm(SHIPPED)
    state = moved(arm, bend(1.0))
    kept = state.centreline_mm.copy()
    state.centreline_mm[:] = -1.0
    state.actuator_forces[:] = -1.0
    moved(arm, bend(2.0))
    np.testing.assert_array_equal(moved(TendonArm(SHIPPED), bend(1.0)).centreline_mm, kept)


def test_jumps_over_the_whole_travel_are_solved() -> None:
    """Any motors of the shipped axes' travel, also where all tendons pull against each other."""
    arm, generator = TendonArm(SHIPPED), np.random.default_rng(7)
    for _ in range(60):
        load = TipLoad(float(generator.uniform(0, 100)))
        state = moved(arm, generator.uniform(-15, 15, 4), load)
        assert np.isfinite(state.centreline_mm).all()
        assert (state.actuator_forces >= 0.0).all()
        assert np.linalg.norm(state.tip.quaternion) == pytest.approx(1.0)


def test_it_stands_a_hard_push_from_any_side() -> None:
    arm, generator = TendonArm(SHIPPED), np.random.default_rng(8)
    for _ in range(10):
        force = generator.normal(0.0, 1.0, 3)
        state = moved(arm, AT_REST, TipLoad(force_n=(force[0], force[1], force[2])))
        assert np.isfinite(state.centreline_mm).all()


def test_variations_are_other_arms_of_the_same_design() -> None:
    arms = [variation(SHIPPED, seed) for seed in range(20)]
    assert arms[4] == variation(SHIPPED, 4)
    assert len({arm.bending_stiffness_n_mm2 for arm in arms}) == 20
    stiffness = [arm.bending_stiffness_n_mm2 / SHIPPED.bending_stiffness_n_mm2 for arm in arms]
    assert 0.9 <= min(stiffness) < 0.95 < 1.05 < max(stiffness) <= 1.1
    torsion = [arm.torsion_stiffness_n_mm2 / SHIPPED.torsion_stiffness_n_mm2 for arm in arms]
    assert torsion == pytest.approx(stiffness), "one batch"
    assert all(len({tendon.angle_rad for tendon in arm.tendons}) == 4 for arm in arms)
    tips = [led(TendonArm(arm), AT_REST, bend(4.0)).tip.position_mm for arm in arms[:4]]
    assert np.ptp(tips, axis=0).max() > 0.5


def test_no_kernel_is_compiled_again_while_the_arm_moves() -> None:
    """A second signature would cost seconds in the middle of the loop."""
    arm = TendonArm(SHIPPED)
    for place in walk(4, 30):
        moved(arm, place, TipLoad(30.0))
    moved(arm, [8.0, 8.0, 8.0, 8.0])
    for kernel in (
        rod_kernels.march,
        rod_kernels.tangent,
        rod_kernels.unstable_directions,
        rod_kernels.newton_step,
        rod_kernels.broyden,
        tendon_arm_kernels.imbalance,
        tendon_arm_kernels.memory,
    ):
        assert len(kernel.signatures) == 1, kernel
