"""What friction, play and slack make of the tendon-driven arm: where it came from matters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.emulation.plants import TendonArmPlant
from drivers.pose import rotate
from sim_backends.plants.plant import BodyState, FloatArray
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm
from tests.sim_backends.plants.tendon_arms import (
    SHIPPED,
    SMOOTH,
    TIGHT,
    bend,
    led,
    moved,
    paid_out,
    plant,
    walk,
    with_tendons,
)

AT_REST = np.zeros(4)
SHIPPED_ARM, TIGHT_ARM, SMOOTH_ARM = TendonArm(SHIPPED), TendonArm(TIGHT), TendonArm(SMOOTH)


def newly_strung(arm: TendonArm) -> TendonArm:
    """The same arm without a past; strung anew each would take a while."""
    arm.reset()
    return arm


def angles_at_plates(config: TendonArmPlant, arm: TendonArm) -> FloatArray:
    """(n, m) angles by which the tendons turn at base plate and disks, written independently."""
    march = arm._memory.equilibrium.march
    every = (len(march.position_mm) - 1) // config.disks
    along = np.linspace(0.0, 1.0, config.disks + 1)
    places = []
    for k, share in enumerate(along):
        node = k * every
        for tendon in config.tendons:
            around = tendon.angle_rad + 2 * np.pi * tendon.turns * share
            hole = config.tendon_radius_mm * np.array([np.cos(around), np.sin(around), 0.0])
            places.append(march.position_mm[node] + rotate(march.quaternion[node], hole))
    holes = np.array(places).reshape(config.disks + 1, -1, 3)
    spans = np.diff(holes, axis=0)
    behind = np.broadcast_to([0.0, 0.0, 1.0], spans[:1].shape)
    before, after = np.concatenate([behind, spans[:-1]]), spans
    cosine = (before * after).sum(-1) / np.linalg.norm(before, axis=-1)
    return np.asarray(np.arccos(np.minimum(1.0, cosine / np.linalg.norm(after, axis=-1))))


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.25, 0.5]))
def test_no_hole_holds_more_than_euler_and_eytelwein_allow(seed: int, friction: float) -> None:
    config = plant(friction=friction)
    arm, generator, here = TendonArm(config), np.random.default_rng(seed), AT_REST
    for _ in range(2):
        goal = paid_out(generator)
        led(arm, here, goal, step_mm=1.0)
        here = goal
        taut = arm.tension_n[:-1].min(axis=0) > 1e-3
        ratio = np.abs(np.log(arm.tension_n[1:, taut] / arm.tension_n[:-1, taut]))
        allowed = friction * angles_at_plates(config, arm)[:, taut]
        assert (ratio <= allowed + 1e-5).all()


def test_a_tendon_that_is_pulled_loses_tension_at_every_hole_by_the_whole_friction() -> None:
    arm = newly_strung(TIGHT_ARM)
    led(arm, AT_REST, np.array([0.0, 0.0, 0.0, 8.0]))
    tension = arm.tension_n[:, 3]
    lost = TIGHT.friction * angles_at_plates(TIGHT, arm)[:, 3]
    np.testing.assert_allclose(np.log(tension[:-1] / tension[1:]), lost, rtol=1e-4)
    assert tension[-1] < 0.8 * tension[0]
    led(arm, np.array([0.0, 0.0, 0.0, 8.0]), np.array([0.0, 0.0, 0.0, 3.0]))
    tension = arm.tension_n[:, 3]
    assert (np.diff(tension) > 0.0).all(), "let out, it is held back on its way"


def test_a_winding_tendon_wraps_by_half_a_turn_even_on_a_straight_arm() -> None:
    """Each of eight disks turns it by 2 asin(sin 19.8° sin 30°), the base plate by 19.8°."""
    config = plant(pretension_n=0.02)
    slope = np.arctan2(2 * 8.0 * np.sin(np.pi / 6), 200.0 / 9)
    expected = slope + 8 * 2 * np.arcsin(np.sin(slope) * np.sin(np.pi / 6))
    wrapped = angles_at_plates(config, TendonArm(config))[:, 3].sum()
    assert wrapped == pytest.approx(expected, rel=0.01)
    assert wrapped > 3.0


def test_a_tendon_that_the_body_drags_out_is_tighter_inside_than_at_its_motor() -> None:
    arm = newly_strung(TIGHT_ARM)
    led(arm, AT_REST, np.array([0.0, 3.0, 3.0, 0.0]))
    at_motor, inside = arm.tension_n[0, 0], arm.tension_n[1:, 0]
    assert at_motor > TIGHT.pretension_n + 1.0, "its motor does not give way"
    assert inside.max() > 1.03 * at_motor


def curvatures(state: BodyState) -> FloatArray:
    """(n,) angle per mm between neighbouring pieces of the centreline."""
    pieces = np.diff(state.centreline_mm, axis=0)
    length = np.linalg.norm(pieces, axis=1)
    cosine = (pieces[:-1] * pieces[1:]).sum(axis=1) / (length[:-1] * length[1:])
    return np.asarray(np.arccos(np.minimum(cosine, 1.0)) / length[1:])


def test_pulling_bends_it_near_the_base_and_letting_out_leaves_the_bend_at_the_tip() -> None:
    config = with_tendons((0.0, 0.0), friction=0.3)
    arm = TendonArm(config)
    goal, beyond = np.array([8.0]), np.array([12.0])
    pulled = curvatures(led(arm, np.zeros(1), goal))
    led(arm, goal, beyond)
    let_out = curvatures(led(arm, beyond, goal))
    assert pulled[1] > 1.1 * pulled[-2]
    assert let_out[-2] > 1.1 * let_out[1]


def widths_of_a_loop(arm: TendonArm) -> FloatArray:
    """(n, 3) tip on the way back minus tip on the way there, at the same motors, in the second
    round trip of a bend by 30 mm."""
    newly_strung(arm)
    pulls = np.linspace(0.0, 3.0, 31)
    for _ in range(2):
        there = [moved(arm, bend(pull)).tip.position_mm for pull in pulls]
        back = [moved(arm, bend(pull)).tip.position_mm for pull in pulls[::-1]]
    return np.array(back)[::-1] - np.array(there)


def test_the_way_back_is_another_one_by_millimetres() -> None:
    """Play lets the tip lag behind; friction, which bends the base more while it is pulled and the
    tip more while it is let out, lets it lead where motors and not tensions are given."""
    play = widths_of_a_loop(TendonArm(plant(friction=0.0)))
    rubbing = widths_of_a_loop(TIGHT_ARM)
    smooth = widths_of_a_loop(SMOOTH_ARM)
    assert 1.5 < play[15, 0] < 3.5, "twice 0.1 mm, by 12.5"
    assert -5.0 < rubbing[15, 0] < -0.8
    assert np.abs(smooth).max() < 1e-4
    assert np.linalg.norm(widths_of_a_loop(SHIPPED_ARM), axis=1).max() > 0.8


def test_a_loop_closes_where_it_turns_and_repeats_itself() -> None:
    arm, pulls = newly_strung(SHIPPED_ARM), np.linspace(0.0, 3.0, 16)
    rounds = []
    for _ in range(3):
        ways = [*pulls, *pulls[::-1]]
        rounds.append(np.array([moved(arm, bend(pull)).tip.position_mm for pull in ways]))
    np.testing.assert_allclose(rounds[2], rounds[1], atol=0.02)


def tips_by_start(arm: TendonArm, seed: int, targets: int, starts: int) -> FloatArray:
    """(targets, starts, 3) tips at the same motors, led there from random others."""
    generator = np.random.default_rng(seed)
    tips = []
    for _ in range(targets):
        goal = paid_out(generator)
        for _ in range(starts):
            newly_strung(arm)
            start = paid_out(generator)
            led(arm, AT_REST, start, step_mm=1.0)
            tips.append(led(arm, start, goal, step_mm=1.0).tip.position_mm)
    return np.array(tips).reshape(targets, starts, 3)


def test_where_it_came_from_shows_in_the_shape_by_millimetres() -> None:
    """As in the paper's figure 3: the same motors, many shapes."""
    tips = tips_by_start(SHIPPED_ARM, 3, targets=8, starts=8)
    away = np.linalg.norm(tips - tips.mean(axis=1, keepdims=True), axis=2)
    spread = np.sqrt((away**2).mean(axis=1))
    assert 1.0 < spread.mean() < 3.0
    assert away.max() < 12.0


def test_without_friction_and_play_it_does_not_matter_where_it_came_from() -> None:
    tips = tips_by_start(SMOOTH_ARM, 4, targets=3, starts=4)
    assert np.ptp(tips, axis=1).max() < 1e-4


def test_a_motion_may_be_told_in_any_number_of_steps() -> None:
    """As long as it goes one way: slow is not different from fast, either."""
    tips = []
    for steps, dt_s in ((1, 0.0), (6, 10.0), (60, 0.025)):
        arm = newly_strung(SHIPPED_ARM)
        for k in range(1, steps + 1):
            state = moved(arm, bend(3.0 * k / steps, 0.5), dt_s=dt_s)
        tips.append(state.tip.position_mm)
    np.testing.assert_allclose(tips, np.broadcast_to(tips[0], (3, 3)), atol=0.01)


def test_within_its_play_a_motor_moves_nothing() -> None:
    arm = newly_strung(SHIPPED_ARM)
    there = led(arm, AT_REST, bend(2.0))
    for back_mm in (0.05, 0.1, 0.19):
        back = moved(arm, bend(2.0) - back_mm * np.sign(bend(2.0)))
        np.testing.assert_allclose(back.centreline_mm, there.centreline_mm, atol=1e-6)
    beyond = moved(arm, bend(2.0) - 0.3 * np.sign(bend(2.0)))
    assert np.linalg.norm(beyond.tip.position_mm - there.tip.position_mm) > 0.3


def test_what_slips_little_is_given_back() -> None:
    """Before a tendon slips, its hole gives way a little: a tiny motion leaves no trace."""
    arm = newly_strung(TIGHT_ARM)
    led(arm, AT_REST, bend(2.0))
    here = moved(arm, bend(2.0) + 0.004).tip.position_mm
    moved(arm, bend(2.0) + 0.002)
    again = moved(arm, bend(2.0) + 0.004).tip.position_mm
    np.testing.assert_allclose(again, here, atol=1e-3)


def test_reset_forgets_where_it_came_from() -> None:
    arm = newly_strung(SHIPPED_ARM)
    first = [moved(arm, place).centreline_mm.tobytes() for place in walk(9, 20)]
    arm.reset()
    assert [moved(arm, place).centreline_mm.tobytes() for place in walk(9, 20)] == first
