"""What a jump tells of a load, and what that makes of the body."""

import numpy as np
import pytest
from scipy.optimize import brentq

from daemon.control.lag.disturbance import Jump
from daemon.control.lag.load import Load, times_as_far
from drivers.pose import Vector
from tests.daemon.control.lag.test_disturbance import REST_MM, on_a_circle, scaled


def loaded(*jumps: Jump) -> Load:
    load = Load()
    load.rest_mm = REST_MM
    for jump in jumps:
        load.hang(jump)
    return load


@pytest.mark.parametrize("turns", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("ratio", [0.7, 0.9, 1.2, 1.5])
def test_a_jump_along_the_way_from_rest_tells_what_a_load_makes_of_it(
    ratio: float, turns: float
) -> None:
    assert times_as_far(scaled(on_a_circle(turns), ratio - 1.0), REST_MM) == pytest.approx(ratio)


@pytest.mark.parametrize("ratio", [0.7, 1.1, 1.3])
def test_a_load_counts_in_full_across_the_way_from_rest_and_less_along_it(ratio: float) -> None:
    load, way = loaded(scaled(on_a_circle(0.0), ratio - 1.0)), on_a_circle(0.3) - REST_MM
    along = way / np.linalg.norm(way)
    across = np.cross(along, [0.0, 0.0, 1.0])
    matrix = load.matrix_at(on_a_circle(0.3))
    np.testing.assert_allclose(matrix @ across, ratio * across, atol=1e-12)
    np.testing.assert_allclose(matrix @ along, np.sqrt(ratio) * along, rtol=0.03)
    np.testing.assert_allclose(load.matrix_at(REST_MM), ratio * np.eye(3))


LONG_MM = 200.0


def rod(share: float, told_rad: float) -> tuple[float, Vector]:
    """A rod on a hinge with a spring, bent as much as it is told, on which a load pulls down that
    is such a share of the one that fells it: the angle that its tip is turned by, and where it is.
    """
    turned = brentq(lambda angle: angle - share * np.sin(angle) - told_rad, 0.0, np.pi)
    seen = 0.5 * turned
    return turned, LONG_MM * np.array([np.sin(seen), 0.0, np.cos(seen)])


@pytest.mark.parametrize("share", [0.55, 0.65, 0.72])
def test_a_heavy_load_makes_a_body_softer_the_nearer_it_comes_to_straight(share: float) -> None:
    """It is hung on, and the body is told back to where it was."""
    told_rad = 0.33
    _, unloaded = rod(0.0, told_rad)
    _, fallen = rod(share, told_rad)
    load = loaded(Jump(unloaded, fallen - unloaded))
    found = []
    for told in np.linspace(told_rad, 0.3 * told_rad, 8):
        turned, place = rod(share, float(told))
        more, _ = rod(share, float(told) + 1e-4)
        way = place - REST_MM
        along = way / np.linalg.norm(way)
        found.append(float(along @ load.matrix_at(place) @ along))
        comes = max(0.8 * (more - turned) / 1e-4, float(np.sqrt(load.hung.times)))
        assert found[-1] == pytest.approx(comes, rel=0.1)
    assert found == sorted(found)
    assert found[-1] > 1.15 * found[0]


def test_loads_are_told_apart_one_upon_the_other() -> None:
    """What hangs already pulls as well: two halves are as one."""
    (_, at), (_, half), (_, whole) = (rod(share, 0.33) for share in (0.0, 0.35, 0.7))
    once, twice = (
        loaded(Jump(at, whole - at)),
        loaded(Jump(at, half - at), Jump(half, whole - half)),
    )
    np.testing.assert_allclose(once.hung, twice.hung, rtol=1e-6)
    assert once.hung.share == pytest.approx(0.7)


@pytest.mark.parametrize("turns", [0.0, 0.4])
def test_a_load_that_is_taken_off_leaves_the_body_as_it_was(turns: float) -> None:
    on = scaled(on_a_circle(0.0), 0.4)
    off = scaled(REST_MM + 1.4 * (on_a_circle(turns) - REST_MM), 1.0 / 1.4 - 1.0)
    assert loaded(on, off).hung.times == pytest.approx(1.0)


def test_what_is_told_of_loads_has_its_limits() -> None:
    far = scaled(on_a_circle(0.0), 8.0)
    assert loaded(far).hung.times == loaded(far, far).hung.times == 4.0
    assert loaded(Jump(far.from_mm, -far.by_mm)).hung.times == 0.25
    for number in range(40):
        matrix = loaded(far, far).matrix_at(on_a_circle(number / 40))
        assert (np.linalg.eigvalsh(matrix) > 0.0).all() and np.linalg.norm(matrix, 2) <= 4.0 + 1e-9


BENT_AT_REST_MM = np.array([-8.0, 9.0, 168.0])


@pytest.mark.parametrize("ratio", [0.6, 1.7, 2.5])
@pytest.mark.parametrize("rest_mm", [REST_MM, BENT_AT_REST_MM])
def test_how_far_a_body_is_stretched_does_not_count_nor_that_it_rests_bent(
    rest_mm: Vector, ratio: float
) -> None:
    """A load bends it further, away from where it would be straight, and hardly stretches it."""
    for turns in (0.1, 0.4, 0.8):
        place = np.array([15.0, 15.0, 195.0]) * on_a_circle(turns) / [30.0, 30.0, 185.0]
        by_mm = (ratio - 1.0) * place * [1.0, 1.0, 0.0] + [0.0, 0.0, -2.0]
        assert times_as_far(Jump(place, by_mm), rest_mm) == pytest.approx(ratio)


def test_a_push_aside_and_a_tip_at_rest_tell_nothing_of_a_load() -> None:
    across = np.cross(on_a_circle(0.0) - REST_MM, [0.0, 0.0, 1.0])
    assert times_as_far(Jump(on_a_circle(0.0), across), REST_MM) == 1.0
    at_rest = Jump(REST_MM, np.array([12.0, 0.0, 0.0]))
    assert times_as_far(at_rest, REST_MM) == 1.0


def test_nobody_is_told_of_a_load_who_has_not_seen_the_body_at_rest() -> None:
    load = Load()
    load.hang(scaled(on_a_circle(0.0), 0.4))
    np.testing.assert_array_equal(load.matrix_at(on_a_circle(0.0)), np.eye(3))
