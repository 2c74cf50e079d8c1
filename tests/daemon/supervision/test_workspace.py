"""Which motions lead the tip out of its workspace, by how far outside it is from cycle to cycle."""

from daemon.supervision.checks import WorkspaceMonitor


def held_at(*course: tuple[float, bool]) -> int | None:
    """The first of (mm outside, moving) at which the motion leads out; None: none does."""
    monitor = WorkspaceMonitor()
    found = [monitor.leaves(outside_mm, moving) for outside_mm, moving in course]
    return found.index(True) if any(found) else None


def moving(*places_mm: float) -> list[tuple[float, bool]]:
    return [(place_mm, True) for place_mm in places_mm]


def test_a_motion_that_leaves_it_is_held_at_once() -> None:
    assert held_at(*moving(-5.0, -0.1, 0.1)) == 2
    assert held_at(*moving(-5.0, -0.1, 0.0, -0.1)) is None


def test_what_stands_is_not_held_and_may_then_be_led_back() -> None:
    standing = [(0.0, False), (8.0, False), (20.0, False)]
    assert held_at(*standing) is None
    assert held_at(*standing, *moving(20.5, 21.9, 20.0, 12.0, 3.0, 0.5, -1.0, -4.0)) is None


def test_what_is_led_back_goes_hardly_farther_out_than_where_it_was_nearest() -> None:
    standing = [(20.0, False)]
    assert held_at(*standing, *moving(21.0, 22.1)) == 2
    assert held_at(*standing, *moving(20.0, 10.0, 11.9, 12.1)) == 4


def test_noise_at_the_wall_does_not_hold_what_comes_in() -> None:
    standing = [(0.3, False)]
    assert held_at(*standing, *moving(0.2, -0.4, 0.3, -0.7, 0.6, -1.5, 0.4)) is None
    assert held_at(*standing, *moving(0.2, -1.0, -2.0, -0.1, 0.1)) == 5


def test_what_stood_inside_may_not_be_led_out() -> None:
    assert held_at((5.0, False), (-0.1, False), *moving(-0.1, 0.1)) == 3


def test_who_is_nobody_knows_where_is_held() -> None:
    nobody_knows = float("nan")
    assert held_at((-5.0, False), *moving(-5.0, nobody_knows)) == 2
    assert held_at((nobody_knows, False), *moving(-5.0, 0.1)) == 2


def test_without_a_workspace_nothing_is_outside() -> None:
    nowhere = float("-inf")
    assert held_at((nowhere, False), *moving(nowhere, nowhere)) is None
