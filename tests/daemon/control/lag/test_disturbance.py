"""A tip that was taken off at once is known as such, once, and until it is back."""

import numpy as np
import pytest
from scipy.optimize import brentq

from daemon.control.lag.disturbance import Disturbance, Jump, Load
from drivers.pose import Vector

DT_S = 0.025
LAG_S = 0.5


def shown(off_mm: Vector, told_mm: Vector | None = None) -> Disturbance:
    """(n, 3) step by step."""
    disturbance = Disturbance()
    told = np.zeros_like(off_mm) if told_mm is None else told_mm
    for k, (off, arrived) in enumerate(zip(off_mm, told, strict=True)):
        disturbance.add(k * DT_S, off, arrived, LAG_S)
    return disturbance


def test_a_jump_is_noticed_once_and_the_way_back_from_it_ends() -> None:
    off = np.zeros((120, 3))
    off[60:, 0] = 14.0
    disturbance, still = Disturbance(), np.zeros(3)
    jumps = [disturbance.add(k * DT_S, place, still, LAG_S) for k, place in enumerate(off)]
    [(noticed, jump)] = [(k, jump) for k, jump in enumerate(jumps) if jump is not None]
    assert noticed == 60
    assert jump.from_mm.tolist() == [0.0, 0.0, 0.0]
    assert jump.by_mm.tolist() == [14.0, 0.0, 0.0]
    later = shown(off)
    assert later.just_jumped(60 * DT_S + 1.3)
    assert not later.just_jumped(60 * DT_S + 1.8)
    assert later.jumped(60 * DT_S + 1.9)
    assert not later.jumped(60 * DT_S + 2.5)


def test_what_is_told_otherwise_than_it_comes_is_no_jump() -> None:
    told = np.zeros((80, 3))
    told[:, 0] = 60.0 * DT_S * np.arange(80)
    assert not shown(-0.3 * told, told).jumped(79 * DT_S)


def test_a_body_that_goes_twice_as_far_as_told_all_the_time_is_not_pushed() -> None:
    """A load made it soft: what it is off by, it was off by before, and turns with the path."""
    angle = 29.0 / 28.0 * DT_S * np.arange(240)
    path = 14.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(240)])
    assert not shown(path, path).jumped(239 * DT_S)
    loaded = path.copy()
    loaded[180:, 2] += 12.0
    assert shown(loaded, path).jumped(239 * DT_S)


def test_a_tip_that_is_off_to_and_fro_was_not_pushed() -> None:
    """By 3 mm one way and then the other: the difference is 6 mm, and nothing was as far off."""
    times = DT_S * np.arange(240)
    off = 1.6 * np.sin(2.0 * np.pi * times / 0.6)[:, None] * np.array([0.8, 0.6, 0.0])
    for k in range(240):
        assert not shown(off[: k + 1]).jumped(k * DT_S)
    pushed = off.copy()
    pushed[200:, 2] += 12.0
    assert shown(pushed).jumped(239 * DT_S)


def test_noise_and_what_grows_slowly_are_no_jump() -> None:
    noise = 0.3 * np.random.default_rng(3).normal(size=(400, 3))
    assert not shown(noise).jumped(400 * DT_S)
    slow = DT_S * np.arange(80)[:, None] * np.array([[8.0, 0.0, -6.0]])
    assert not shown(slow).jumped(80 * DT_S)


def test_motion_that_begins_anew_knows_of_no_jump() -> None:
    off = np.zeros((70, 3))
    off[60:, 0] = 14.0
    disturbance = shown(off)
    disturbance.begin()
    assert not disturbance.jumped(70 * DT_S)
    assert not disturbance.just_jumped(70 * DT_S)


REST_MM = np.array([0.0, 0.0, 210.0])


def on_a_circle(turns: float) -> Vector:
    angle = 2.0 * np.pi * turns
    return np.array([30.0 * np.cos(angle), 30.0 * np.sin(angle), 185.0])


def scaled(place_mm: Vector, share: float) -> Jump:
    """All of the body's ways from its rest become so much longer."""
    return Jump(place_mm, share * (place_mm - REST_MM))


@pytest.mark.parametrize("ratio", [0.6, 1.6], ids=["stiffer with it", "softer with it"])
@pytest.mark.parametrize("turns", [0.0, 0.1, 0.3, 0.5, 0.9])
def test_a_load_that_is_taken_off_elsewhere_undoes_what_hanging_it_on_did(
    ratio: float, turns: float
) -> None:
    on = scaled(on_a_circle(0.0), ratio - 1.0)
    off = scaled(on_a_circle(turns), 1.0 / ratio - 1.0)
    more = scaled(on_a_circle(turns), ratio - 1.0)
    for known in (0.9 * ratio + 0.1, ratio, 1.1 * ratio - 0.1):
        assert off.undoes(on, known)
        assert not more.undoes(on, known)


def test_a_force_that_changes_no_gain_is_undone_by_its_opposite() -> None:
    pushed = Jump(on_a_circle(0.0), np.array([0.0, 0.0, -9.0]))
    released = Jump(on_a_circle(0.4), np.array([0.0, 0.5, 8.0]))
    aside = Jump(on_a_circle(0.4), np.array([0.0, 8.0, 0.5]))
    assert released.undoes(pushed, 1.01)
    assert not aside.undoes(pushed, 1.01)
    assert not pushed.undoes(pushed, 1.01)


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
    assert scaled(on_a_circle(turns), ratio - 1.0).times_as_far(REST_MM) == pytest.approx(ratio)


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
        assert 0.0 < np.linalg.eigvalsh(matrix).max() <= 4.0 + 1e-9


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
        assert Jump(place, by_mm).times_as_far(rest_mm) == pytest.approx(ratio)


def test_a_heavier_load_is_not_the_one_that_was_taken_off_before() -> None:
    off = scaled(on_a_circle(0.0), 1.0 / 1.7 - 1.0)
    again, heavier = scaled(on_a_circle(0.4), 0.7), scaled(on_a_circle(0.4), 2.0)
    assert again.undoes(off, 1.0 / 1.7)
    assert not heavier.undoes(off, 1.0 / 1.7)


def test_a_push_aside_and_a_tip_at_rest_tell_nothing_of_a_load() -> None:
    across = np.cross(on_a_circle(0.0) - REST_MM, [0.0, 0.0, 1.0])
    assert Jump(on_a_circle(0.0), across).times_as_far(REST_MM) == 1.0
    at_rest = Jump(REST_MM, np.array([12.0, 0.0, 0.0]))
    assert at_rest.times_as_far(REST_MM) == 1.0


def test_nobody_is_told_of_a_load_who_has_not_seen_the_body_at_rest() -> None:
    load = Load()
    load.hang(scaled(on_a_circle(0.0), 0.4))
    np.testing.assert_array_equal(load.matrix_at(on_a_circle(0.0)), np.eye(3))
