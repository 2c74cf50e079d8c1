"""The rod against closed forms, its own symmetries and thermodynamics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.pose import rotate
from sim_backends.plants.rod import Rod, Section, helix
from sim_backends.plants.rod_kernels import FloatArray
from tests.sim_backends.plants.rods import (
    ARM_SECTION,
    CHAMBER_RADIUS_MM,
    LENGTH_MM,
    NO_FORCE,
    TENDON_RADIUS_MM,
    TENDON_SECTION,
    bare_rod,
    chamber_rod,
    equilibrium,
    tendon_rod,
    tip_mm,
)

pulls = st.lists(st.floats(0.1, 6.0), min_size=4, max_size=4).map(np.array)
pushes = st.lists(st.floats(0.0, 25.0), min_size=6, max_size=6).map(lambda p: -np.array(p))
forces = st.lists(st.floats(-0.25, 0.25), min_size=3, max_size=3).map(np.array)


def test_a_cantilever_bends_as_euler_bernoulli_and_timoshenko_say() -> None:
    section = Section(bending_n_mm2=1e4, torsion_n_mm2=8e3, shear_n=500.0, axial_n=1500.0)
    force = 1e-5
    found = equilibrium(bare_rod(section), [], [force, 0.0, 0.0])
    expected = force * 100.0**3 / (3 * 1e4) + force * 100.0 / 500.0
    assert tip_mm(found)[0] == pytest.approx(expected, rel=1e-6)


def test_its_own_weight_bends_a_cantilever_as_an_even_load() -> None:
    section = Section(bending_n_mm2=1e4, torsion_n_mm2=8e3, shear_n=1e9, axial_n=1e9)
    weight = 1e-5
    found = equilibrium(bare_rod(section), [], NO_FORCE, [0.0, weight, 0.0])
    assert tip_mm(found)[1] == pytest.approx(weight * 100.0**3 / (8 * 1e4), rel=1e-6)


def arc(pull_n: float, radius_mm: float, section: Section, length_mm: float) -> FloatArray:
    """Tip and route length of a rod that one straight route at x = radius_mm bends."""
    stretch, bend = 1.0 - pull_n / section.axial_n, pull_n * radius_mm / section.bending_n_mm2
    angle = bend * length_mm
    x, z = stretch / bend * (1.0 - np.cos(angle)), stretch / bend * np.sin(angle)
    return np.array([x, 0.0, z, (stretch - radius_mm * bend) * length_mm])


@pytest.mark.parametrize(("pull_n", "chamber"), [(5.0, False), (0.01, False), (-20.0, True)])
def test_one_straight_route_bends_the_rod_into_a_circle(pull_n: float, chamber: bool) -> None:
    section, radius = (
        (ARM_SECTION, CHAMBER_RADIUS_MM) if chamber else (TENDON_SECTION, TENDON_RADIUS_MM)
    )
    rod = Rod(150.0, section, [helix(radius, 0.0, 0.0, 150.0, chamber=chamber)], 60)
    found = equilibrium(rod, [pull_n])
    outcome = np.append(tip_mm(found), found.march.length_mm)
    np.testing.assert_allclose(outcome, arc(pull_n, radius, section, 150.0), atol=2e-5)


def test_even_chambers_leave_the_rod_straight_and_gravity_only_shortens_it() -> None:
    rod, pull, tip, weight = chamber_rod(), -8.0, 0.3, 0.41
    found = equilibrium(rod, [pull] * 6, [0.0, 0.0, -tip], [0.0, 0.0, -weight])
    stretch = 1.0 - (3 * pull + tip + weight / 2) / ARM_SECTION.axial_n
    np.testing.assert_allclose(tip_mm(found), [0.0, 0.0, stretch * rod.length_mm], atol=1e-9)
    np.testing.assert_allclose(found.march.quaternion[-1], [1.0, 0.0, 0.0, 0.0], atol=1e-12)


@settings(deadline=None, max_examples=20)
@given(pushes, st.floats(0.0, 0.3))
def test_turning_the_pressures_by_120_degrees_turns_the_shape(push: FloatArray, tip: float) -> None:
    rod, down = chamber_rod(), [0.0, 0.0, -tip]
    turned = np.concatenate([np.roll(push[:3], 1), np.roll(push[3:], 1)])
    third = np.array([0.5, 0.0, 0.0, np.sqrt(0.75)])
    before = equilibrium(rod, push, down).march.position_mm
    after = equilibrium(rod, turned, down).march.position_mm
    np.testing.assert_allclose(after, [rotate(third, p) for p in before], atol=1e-5)


@settings(deadline=None, max_examples=20)
@given(pushes, st.floats(0.0, 0.3))
def test_mirrored_pressures_give_the_mirrored_shape(push: FloatArray, tip: float) -> None:
    rod, down = chamber_rod(turn_rad=0.0), [0.0, 0.0, -tip]
    mirrored = push[[0, 2, 1, 3, 5, 4]]  # y to -y swaps the chambers at +120° and -120°
    before = equilibrium(rod, push, down).march.position_mm
    after = equilibrium(rod, mirrored, down).march.position_mm
    np.testing.assert_allclose(after, before * [1.0, -1.0, 1.0], atol=1e-5)


def test_a_heavier_load_pulls_the_tip_lower() -> None:
    rod = chamber_rod()
    heights = [
        tip_mm(equilibrium(rod, [-15, 0, 0, -10, 0, 0], [0, 0, -load]))[2]
        for load in (0.0, 0.1, 0.2, 0.3, 0.4)
    ]
    assert (np.diff(heights) < 0).all()


def test_near_upright_each_gram_counts_more_than_the_one_before() -> None:
    rod = chamber_rod()
    aside = [
        np.linalg.norm(tip_mm(equilibrium(rod, [-1, 0, 0, -1, 0, 0], [0, 0, -load]))[:2])
        for load in (0.0, 0.1, 0.2, 0.3, 0.4)
    ]
    assert (np.diff(aside) > 0).all()
    assert (np.diff(aside, 2) > 0).all()


def differences(
    rod: Rod, pull: FloatArray, tip: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """∂ℓ/∂τ, ∂p/∂τ and ∂ℓ/∂F by central differences."""

    def outcome(pull: FloatArray, tip: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = equilibrium(rod, pull, tip, weight)
        return found.march.length_mm, tip_mm(found)

    lengths_by_pull, tip_by_pull, lengths_by_force = [], [], []
    for step in 1e-3 * np.eye(len(pull)):
        above, below = outcome(pull + step, tip), outcome(pull - step, tip)
        lengths_by_pull.append((above[0] - below[0]) / 2e-3)
        tip_by_pull.append((above[1] - below[1]) / 2e-3)
    for step in 1e-4 * np.eye(3):
        above, below = outcome(pull, tip + step), outcome(pull, tip - step)
        lengths_by_force.append((above[0] - below[0]) / 2e-4)
    return (
        np.array(lengths_by_pull).T,
        np.array(tip_by_pull).T,
        np.array(lengths_by_force).T,
    )


def assert_reciprocal(
    lengths_by_pull: FloatArray, tip_by_pull: FloatArray, lengths_by_force: FloatArray
) -> None:
    scale = np.abs(tip_by_pull).max()
    np.testing.assert_allclose(lengths_by_pull, lengths_by_pull.T, atol=1e-6 * scale)
    np.testing.assert_allclose(tip_by_pull, -lengths_by_force.T, atol=3e-5 * scale)


@settings(deadline=None, max_examples=5)
@given(pulls, forces, forces)
def test_maxwell_reciprocity_of_tendons_and_tip(
    pull: FloatArray, tip: FloatArray, weight: FloatArray
) -> None:
    assert_reciprocal(*differences(tendon_rod(60), pull, tip, weight))


@settings(deadline=None, max_examples=4)
@given(pushes, forces)
def test_maxwell_reciprocity_of_chambers_and_tip(push: FloatArray, tip: FloatArray) -> None:
    assert_reciprocal(*differences(chamber_rod(60), push, tip, np.array([0, 0, -0.4])))


def test_the_error_falls_with_the_fourth_power_of_the_interval() -> None:
    def tip(intervals: int) -> FloatArray:
        return tip_mm(equilibrium(tendon_rod(intervals), [3, 0.5, 1, 6], [0.1, -0.3, 0.1]))

    exact = tip(240)
    errors = [float(np.linalg.norm(tip(n) - exact)) for n in (15, 30, 60)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.35)


def test_accurate_to_20_micrometres_with_18_intervals() -> None:
    for pull in ([3, 0.5, 0.5, 2], [8, 0, 1, 6], [0, 6, 0, 10], [1, 1, 1, 16]):
        coarse, fine = (
            tip_mm(equilibrium(tendon_rod(n), pull, [0, -0.3, 0], [0, -0.3, 0])) for n in (18, 144)
        )
        assert np.linalg.norm(coarse - fine) < 0.02, pull


def two_arcs(bends: tuple[float, float], half_mm: float) -> FloatArray:
    """Tip of two arcs in the x-z plane, one after the other."""
    first, second = bends[0] * half_mm, bends[1] * half_mm
    middle = np.array([1 - np.cos(first), 0.0, np.sin(first)]) / bends[0]
    onward = np.array([1 - np.cos(second), 0.0, np.sin(second)]) / bends[1]
    turn = np.array([np.cos(first / 2), 0.0, np.sin(first / 2), 0.0])
    return np.asarray(middle + rotate(turn, onward))


def unstretchable(bending: float = 1e4) -> Section:
    return Section(bending_n_mm2=bending, torsion_n_mm2=1e4, shear_n=1e9, axial_n=1e9)


def bent_by(rod: Rod, tension: FloatArray, stiffness: FloatArray, rest: FloatArray) -> FloatArray:
    """Tip of a rod without forces: its base moment is zero."""
    force = rod.internal_force(NO_FORCE, NO_FORCE)
    march = rod.march(rod.loaded(tension, force, stiffness, rest), NO_FORCE, rod.rest)
    assert march is not None
    return np.asarray(march.position_mm[-1])


@pytest.mark.parametrize("chamber", [False, True])
def test_tension_may_change_along_a_route_as_friction_makes_it(chamber: bool) -> None:
    rod = Rod(100.0, unstretchable(), [helix(8.0, 0.0, 0.0, 100.0, chamber=chamber)], 40)
    tension = np.where(rod.places_mm[:, 1] < 50.0, 12.0, 7.0)[:, None]
    tip = bent_by(rod, tension, rod.stiffness, rod.rest)
    np.testing.assert_allclose(tip, two_arcs((12 * 8e-4, 7 * 8e-4), 50.0), atol=1e-5)


def test_stiffness_may_change_along_the_rod() -> None:
    rod = Rod(100.0, unstretchable(), [helix(8.0, 0.0, 0.0, 100.0)], 40)
    softer = rod.stiffness * np.where(rod.places_mm[:, 1] < 50.0, 1.0, 0.5)[:, None]
    tip = bent_by(rod, 10.0 * rod.presence, softer, rod.rest)
    np.testing.assert_allclose(tip, two_arcs((8e-3, 16e-3), 50.0), atol=1e-5)


def test_a_rod_may_be_curved_at_rest() -> None:
    rod = bare_rod(unstretchable())
    rest = rod.rest.copy()
    rest[..., 4] = 0.02
    tip = bent_by(rod, np.zeros((rod.intervals, 0)), rod.stiffness, rest)
    np.testing.assert_allclose(tip, two_arcs((0.02, 0.02), 50.0), atol=1e-5)


def test_a_route_that_ends_half_way_bends_only_the_first_half() -> None:
    rod = Rod(100.0, unstretchable(), [helix(8.0, 0.0, 0.0, 50.0)], 40)
    tip = bent_by(rod, 10.0 * rod.presence, rod.stiffness, rod.rest)
    np.testing.assert_allclose(tip, two_arcs((8e-3, 1e-12), 50.0), atol=1e-3)


def test_nodes_fall_on_every_end_of_a_route_and_every_break() -> None:
    routes = [helix(5.0, 0.0, 0.0, 61.0), helix(5.0, 0.0, 61.0, 100.0, chamber=True)]
    rod = Rod(100.0, TENDON_SECTION, routes, 10, breaks_mm=(13.0, 100.0))
    assert {0.0, 13.0, 61.0, 100.0} <= set(rod.nodes_mm)
    assert rod.nodes_mm == pytest.approx(sorted(rod.nodes_mm))
    assert rod.presence.sum(axis=1) == pytest.approx(1.0), "each interval has one of the two"


def test_the_tangent_is_what_finite_differences_say() -> None:
    rod = tendon_rod(120)
    pull = np.array([2.0, 0.5, 1.0, 3.0])
    found = equilibrium(rod, pull, [0.1, -0.2, 0.1], [0, -0.2, 0])
    force = rod.internal_force(np.array([0.1, -0.2, 0.1]), np.array([0, -0.2, 0]))

    def outcome(unknowns: FloatArray) -> FloatArray:
        loaded = rod.loaded(rod.presence * unknowns[3:], force, rod.stiffness, rod.rest)
        march = rod.march(loaded, unknowns[:3], found.march.strain)
        assert march is not None
        return np.concatenate([march.moment_nmm[-1], march.length_mm])

    steps = 1e-3 * np.eye(7)
    columns = [(outcome(found.unknowns + s) - outcome(found.unknowns - s)) / 2e-3 for s in steps]
    scale = np.abs(np.array(columns)).max()
    np.testing.assert_allclose(found.response, np.array(columns).T, atol=2e-4 * scale)


def test_a_rod_pressed_flat_is_no_rod() -> None:
    rod = bare_rod(ARM_SECTION)
    force = rod.internal_force(np.array([0.0, 0.0, -150.0]), NO_FORCE)
    loaded = rod.loaded(np.zeros((rod.intervals, 0)), force, rod.stiffness, rod.rest)
    assert rod.march(loaded, NO_FORCE, rod.rest) is None


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_no_march_comes_back_from_numbers_that_are_none(poison: float) -> None:
    for rod in (tendon_rod(9), chamber_rod(10)):
        tension = np.abs(rod.presence) * (1.0 if rod.routes == 4 else -1.0)
        force = rod.internal_force(NO_FORCE, NO_FORCE)
        loaded = rod.loaded(tension, force, rod.stiffness, rod.rest)
        for index in range(3):
            moment = np.zeros(3)
            moment[index] = poison
            assert rod.march(loaded, moment, rod.rest) is None
        bad = loaded._replace(tension=np.where(tension != 0, poison, 0.0))
        assert rod.march(bad, NO_FORCE, rod.rest) is None
        assert rod.march(loaded._replace(force=force + poison), NO_FORCE, rod.rest) is None


def test_the_winding_tendon_is_as_long_as_a_helix() -> None:
    length = equilibrium(tendon_rod(), [0, 0, 0, 0]).march.length_mm
    turn = 3 * np.pi / LENGTH_MM
    assert length[3] == pytest.approx(LENGTH_MM * np.hypot(1.0, TENDON_RADIUS_MM * turn))
    assert length[:3] == pytest.approx(LENGTH_MM)
