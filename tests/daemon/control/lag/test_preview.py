"""Where the reference was and will be is known, and a corner before it is there."""

from collections.abc import Callable

import numpy as np
import pytest

from daemon.control.lag.preview import Preview, Reference
from drivers.pose import Vector

DT_S = 0.025
DEAD_S, FIRST_ORDER_S = 0.2, 0.4
SPEED_MM_S = 20.0
TURNS_AT_S = 4.0

Path = Callable[[float], tuple[Vector, Vector]]


def round_a_circle(radius_mm: float) -> Path:
    def at(t_s: float) -> tuple[Vector, Vector]:
        angle = SPEED_MM_S / radius_mm * t_s
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        along = np.array([-np.sin(angle), np.cos(angle), 0.0])
        return np.asarray(radius_mm * out), np.asarray(SPEED_MM_S * along)

    return at


def round_a_corner(angle_rad: float) -> Path:
    along = SPEED_MM_S * np.array([1.0, 0.0, 0.0])
    further = np.zeros(3)
    further[:2] = SPEED_MM_S * np.cos(angle_rad), SPEED_MM_S * np.sin(angle_rad)

    def at(t_s: float) -> tuple[Vector, Vector]:
        after_s = max(t_s - TURNS_AT_S, 0.0)
        place_mm = (t_s - after_s) * along + after_s * further
        return np.asarray(place_mm), further if after_s > 0.0 else along

    return at


def see(preview: Preview, path: Path | None, t_s: float) -> None:
    if path is None:
        now = Reference(t_s, np.zeros(3), np.zeros(3), None)
    else:
        now = Reference(t_s, *path(t_s), lambda lead_s: path(t_s + lead_s))
    preview.see(now, DT_S, DEAD_S, FIRST_ORDER_S)


def corners(path: Path, until_s: float = 8.0) -> tuple[Vector, Vector]:
    """Times, and how near a corner is said to be."""
    preview, times = Preview(), DT_S * np.arange(round(until_s / DT_S))
    said = []
    for t_s in times:
        see(preview, path, t_s)
        said.append(preview.corner)
    return np.asarray(times, np.float64), np.array(said)


@pytest.mark.parametrize("radius_mm", [10.0, 30.0, 1e9])
def test_a_circle_and_a_straight_line_have_no_corner(radius_mm: float) -> None:
    assert not corners(round_a_circle(radius_mm))[1].any()


@pytest.mark.parametrize("angle_rad", [np.pi / 3.0, np.pi / 2.0, -np.pi])
def test_a_corner_counts_for_as_long_as_what_is_averaged_has_it_in_it(angle_rad: float) -> None:
    times, said = corners(round_a_corner(angle_rad))
    reach_s = 0.65 * FIRST_ORDER_S
    near = np.abs(times + DEAD_S - TURNS_AT_S) < reach_s
    assert said[near].min() > 0.6
    far = np.abs(times + DEAD_S - TURNS_AT_S) > reach_s + FIRST_ORDER_S + 2.0 * DT_S
    assert said[far].max() < 0.05


def test_a_bend_counts_in_part_and_less_than_a_corner() -> None:
    bend, corner = (corners(round_a_corner(angle))[1].max() for angle in (0.45, 0.9))
    assert 0.2 < bend < 0.8 < corner


def test_nothing_of_a_corner_is_left_where_motion_begins_anew() -> None:
    preview, path = Preview(), round_a_corner(np.pi / 2.0)
    for t_s in np.arange(TURNS_AT_S - 1.0, TURNS_AT_S, DT_S):
        see(preview, path, t_s)
    assert preview.corner > 0.5
    preview.begin()
    see(preview, round_a_circle(30.0), 100.0)
    assert preview.corner == 0.0


def test_where_the_reference_was_is_known_between_two_frames_as_well() -> None:
    preview, path = Preview(), round_a_circle(30.0)
    for t_s in np.arange(0.0, 3.0, DT_S):
        see(preview, path, t_s)
    for lead_s in (0.5, 0.0, -0.04, -0.99):
        aim = preview.at(lead_s)
        assert aim is not None
        np.testing.assert_allclose(aim[0], path(t_s + lead_s)[0], atol=0.01)
        np.testing.assert_allclose(aim[1], path(t_s + lead_s)[1], atol=0.4)


def test_where_a_hand_leads_nobody_knows_what_comes() -> None:
    preview = Preview()
    see(preview, round_a_corner(np.pi), TURNS_AT_S - DEAD_S)
    see(preview, None, TURNS_AT_S)
    assert preview.at(0.1) is None
    assert preview.at(-0.1) is None
    assert preview.corner == 0.0
