"""Trajectories that say where the tip points, and the way to where they begin."""

from pathlib import Path

import numpy as np
import pytest

from config.documents.model import OptionsError
from config.tasks.trajectory import load_trajectory_options
from daemon.reference.reference import Blend, TrajectoryReference
from daemon.reference.trajectories import Trajectory, make_trajectory
from daemon.reference.waypoints import WaypointError
from drivers.pose import Vector

CIRCLE = {
    "kind": "circle", "center_mm": [36.0, 0.0, 179.0], "radius_mm": 15.0,
    "cycle_s": 30.0, "cycles": 2,
}  # fmt: skip
ROWS = """t, x, y, z, dx, dy, dz
0, 0, 0, 100, 0, 0, 2
2, 10, 0, 100, 1, 0, 1
4, 10, 9, 100, 0, 1, 0
"""


def trajectory(**options: object) -> Trajectory:
    return make_trajectory(load_trajectory_options({**CIRCLE, **options}), Path())


def pointed(pointing: tuple[Vector, Vector] | None) -> tuple[Vector, Vector]:
    """What there must be."""
    assert pointing is not None
    return pointing


LAWS: list[dict[str, object]] = [
    {"kind": "fixed", "direction": [0.0, 3.0, 4.0]},
    {"kind": "away_from", "point_mm": [-8.0, -12.0, 136.0]},
    {"kind": "towards", "point_mm": [36.0, 0.0, 300.0]},
]


@pytest.mark.parametrize("law", LAWS)
def test_directions_have_unit_length_and_their_change_is_their_derivative(
    law: dict[str, object],
) -> None:
    circle = trajectory(pointing=law)
    assert circle.points
    for t_s in np.linspace(0.1, 59.0, 23):
        before, here, after = (circle.pointing_at(t_s + dt_s) for dt_s in (-1e-4, 0.0, 1e-4))
        assert before is not None
        assert here is not None
        assert after is not None
        assert np.linalg.norm(here[0]) == pytest.approx(1.0)
        np.testing.assert_allclose(here[1], (after[0] - before[0]) / 2e-4, atol=1e-6)


def test_the_laws_point_as_they_say() -> None:
    for law, sign in ((LAWS[1], 1.0), (LAWS[2], -1.0)):
        circle = trajectory(pointing=law)
        pointing = circle.pointing_at(7.0)
        assert pointing is not None
        way = sign * (circle.at(7.0)[0] - np.array(law["point_mm"], dtype=np.float64))
        np.testing.assert_allclose(pointing[0], way / np.linalg.norm(way))
    fixed = trajectory(pointing=LAWS[0]).pointing_at(3.0)
    assert fixed is not None
    assert fixed[0].tolist() == [0.0, 0.6, 0.8]


def test_without_a_law_the_tip_may_point_anywhere() -> None:
    assert not trajectory().points
    assert trajectory().pointing_at(1.0) is None
    reference = TrajectoryReference(trajectory(), 5.0)
    reference.begin(np.array([30.0, 0.0, 170.0]), np.array([0.0, 0.0, 1.0]))
    assert reference.wait().direction is None
    assert reference.advance(0, 0.1).direction is None


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(OptionsError, match="not zero"):
        trajectory(pointing={"kind": "fixed", "direction": [0.0, 0.0, 0.0]})


def test_a_tip_is_led_to_the_first_direction_along_a_great_circle_and_stands_there() -> None:
    one, other = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    place = np.zeros(3)
    blend = Blend(place, place, 5.0, one, other)
    assert blend.duration_s == pytest.approx(1.875 * np.pi / 2.0 / 0.2)
    half, _ = pointed(blend.pointing_at(0.5 * blend.duration_s))
    np.testing.assert_allclose(half, np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0), atol=1e-12)
    end, rate = pointed(blend.pointing_at(blend.duration_s + 1.0))
    np.testing.assert_allclose(end, other, atol=1e-12)
    assert rate.tolist() == [0.0, 0.0, 0.0]
    fastest = max(
        float(np.linalg.norm((blend.pointing_at(t_s) or (one, one))[1]))
        for t_s in np.linspace(0.0, blend.duration_s, 300)
    )
    assert fastest == pytest.approx(0.2, rel=1e-3)


def test_opposite_directions_are_led_round_some_way() -> None:
    blend = Blend(
        np.zeros(3), np.ones(3), 5.0, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
    )
    end, _ = pointed(blend.pointing_at(blend.duration_s))
    np.testing.assert_allclose(end, np.array([0.0, 0.0, -1.0]), atol=1e-9)


def test_a_reference_says_where_to_point_on_the_way_on_the_path_and_while_it_waits() -> None:
    circle = trajectory(pointing=LAWS[1])
    reference = TrajectoryReference(circle, 5.0)
    now = np.array([0.0, 0.6, 0.8])
    reference.begin(np.array([51.0, 0.0, 175.0]), now)
    waiting = reference.wait()
    assert waiting.direction is not None
    np.testing.assert_allclose(waiting.direction, now)
    last = now
    for _ in range(4000):
        aim = reference.advance(0, 0.025)
        assert aim.direction is not None
        assert np.linalg.norm(aim.direction - last) < 0.01, "nothing jumps"
        last = aim.direction
    assert aim.cycle == 1
    there, _ = pointed(circle.pointing_at(reference.elapsed_s))
    np.testing.assert_allclose(last, there)


def test_waypoints_may_say_where_to_point(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text(ROWS)
    way = make_trajectory(
        load_trajectory_options({"kind": "waypoints", "file": "way.csv"}), tmp_path
    )
    pointing = way.pointing_at(1.0)
    assert pointing is not None
    expected = np.array([0.5 / np.sqrt(2.0), 0.0, 0.5 + 0.5 / np.sqrt(2.0)])
    np.testing.assert_allclose(pointing[0], expected / np.linalg.norm(expected))
    end = way.pointing_at(9.0)
    assert end is not None
    np.testing.assert_allclose(end[0], [0.0, 1.0, 0.0])
    rows = [[0.0, 0.0, 0.0, 100.0, 0.0, 0.0, 1.0], [2.0, 10.0, 0.0, 100.0, 1.0, 0.0, 0.0]]
    assert make_trajectory(
        load_trajectory_options({"kind": "waypoints", "points": rows}), tmp_path
    ).points


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (ROWS.replace("0, 0, 2\n", "0, 0, 0\n"), "point nowhere"),
        (ROWS.replace("1, 0, 1\n", "1, 0\n"), "needs 7 numbers, and has 6"),
        (ROWS.replace("dx, dy, dz", "a, b, c"), "the header must be"),
    ],
)
def test_directions_that_are_none_are_told_with_their_line(
    tmp_path: Path, text: str, what: str
) -> None:
    (tmp_path / "way.csv").write_text(text)
    options = load_trajectory_options({"kind": "waypoints", "file": "way.csv"})
    with pytest.raises(WaypointError, match=what):
        make_trajectory(options, tmp_path)


def test_waypoints_and_a_law_cannot_both_say_where_to_point(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text(ROWS)
    options = load_trajectory_options({"kind": "waypoints", "file": "way.csv", "pointing": LAWS[0]})
    with pytest.raises(ValueError, match="and so does `pointing`"):
        make_trajectory(options, tmp_path)
