"""Trajectory and controller options: what is refused, and in which words."""

from typing import Any

import pytest

from config.documents.model import OptionsError
from config.tasks.controllers import Broyden, ConstantCurvature, load_controller_options
from config.tasks.trajectory import Lissajous, Rectangle, load_trajectory_options

RECTANGLE: dict[str, Any] = {
    "kind": "rectangle",
    "center_mm": [0, 0, 185],
    "width_mm": 25,
    "height_mm": 100.0,
    "cycle_s": 60,
    "cycles": 3,
}


def complaints(mapping: dict[str, Any]) -> tuple[str, ...]:
    with pytest.raises(OptionsError) as caught:
        load_trajectory_options(mapping)
    return caught.value.problems


def test_a_rectangle_from_a_message_is_a_rectangle() -> None:
    options = load_trajectory_options(RECTANGLE)
    assert isinstance(options, Rectangle)
    assert (options.center_mm, options.plane, options.cycles) == ((0.0, 0.0, 185.0), "xy", 3)


def test_everything_wrong_is_told_at_once_and_by_name() -> None:
    wrong = {**RECTANGLE, "width_mm": -1, "plane": "zx", "heigth_mm": 3, "cycle_s": float("nan")}
    text = "\n".join(complaints(wrong))
    for part in (
        "trajectory.width_mm: should be greater than or equal to 0.01",
        "trajectory.plane: must be 'xy', 'xz' or 'yz'",
        "trajectory.heigth_mm: unknown key (did you mean 'height_mm'?)",
        "trajectory.cycle_s: should be a finite number",
    ):
        assert part in text


def test_an_unknown_kind_is_told_with_the_nearest_known_one() -> None:
    (text,) = complaints({"kind": "rectange"})
    assert "did you mean 'rectangle'?" in text


def test_a_kind_must_be_given() -> None:
    (text,) = complaints({"center_mm": [0, 0, 0]})
    assert text == "trajectory.kind: this key is required and is not there"


@pytest.mark.parametrize(
    "change",
    [
        {"center_mm": [0, 0]},
        {"center_mm": [0, 0, float("inf")]},
        {"cycles": 0},
        {"cycles": 1.5},
        {"cycle_s": "60"},
    ],
)
def test_numbers_are_not_guessed(change: dict[str, Any]) -> None:
    assert len(complaints({**RECTANGLE, **change})) >= 1


def test_a_lissajous_figure_must_move() -> None:
    figure = {"kind": "lissajous", "center_mm": [0, 0, 185], "cycle_s": 20}
    assert isinstance(load_trajectory_options({**figure, "amplitude_mm": [20, 20, 0]}), Lissajous)
    for still in (
        {"amplitude_mm": [0, 0, 0]},
        {"amplitude_mm": [0, 0, 9], "frequencies": [1, 2, 0]},
    ):
        assert "nothing moves" in complaints({**figure, **still})[0]


def test_a_star_has_points_and_a_random_path_moves() -> None:
    star = {"kind": "star", "center_mm": [0, 0, 185], "radius_mm": 20, "cycle_s": 20}
    assert "or it is no star" in complaints({**star, "inner_radius_mm": 20})[0]
    assert "points" in complaints({**star, "inner_radius_mm": 9, "points": 2})[0]
    still = {"kind": "random_smooth", "center_mm": [0, 0, 185], "size_mm": [0, 0, 0], "cycle_s": 9}
    assert "nothing moves" in complaints(still)[0]


def test_controllers_are_chosen_by_kind() -> None:
    assert isinstance(load_controller_options({"kind": "broyden"}), Broyden)
    options = load_controller_options(
        {
            "kind": "constant_curvature",
            "posture": [10, 10, 10, 20, 20, 20],
            "chambers": {"kind": "volumetric", "elongation_mm_per_ml": 2.0},
        }
    )
    assert isinstance(options, ConstantCurvature)
    assert options.posture == (10.0, 10.0, 10.0, 20.0, 20.0, 20.0)


def test_wrong_controller_options_are_told_by_name() -> None:
    with pytest.raises(OptionsError, match=r"controller\.gain_per_s: should be greater than 0"):
        load_controller_options({"kind": "broyden", "gain_per_s": 0})


@pytest.mark.parametrize("row", [[0.0, 0.0, 185.0], [0], "", 7])
def test_of_many_rows_that_are_none_the_first_is_told(row: Any) -> None:
    """To tell of each of them takes seconds, in which nothing else of the daemon goes on."""
    told = complaints({"kind": "waypoints", "points": [row] * 5000})
    assert "trajectory.points[0]" in told[0]
    assert not any("points[1]" in one for one in told)
    rows = {name: [row] * 5000 for name in ("t_s", "u", "tip_mm")}
    told = complaints({"kind": "planned", "path": rows})
    assert sum(map(len, told)) < 10_000


def test_of_very_many_wrong_keys_the_first_are_told_and_how_many_more_there_are() -> None:
    told = complaints({**RECTANGLE, **{f"key_{n}": 0 for n in range(5000)}})
    assert told[0] == "trajectory.key_0: unknown key"
    assert told[-1] == f"and {5000 - len(told) + 1} more"
    assert sum(map(len, told)) < 10_000
    (told_of_long,) = complaints({**RECTANGLE, "k" * 60_000: 0})
    assert len(told_of_long) < 1000


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "helix", "turns": 1e300},
        {"kind": "circle", "cycle_s": 1e300},
        {"kind": "circle", "cycle_s": 1e-300},
        {"kind": "circle", "cycles": 10**400},
        {"kind": "circle", "radius_mm": 1e-300},
        {"kind": "circle", "radius_mm": 1e300},
        {"kind": "circle", "center_mm": [1e300, 0.0, 0.0]},
        {"kind": "rectangle", "width_mm": 1e-300, "height_mm": 1e-300},
        {"kind": "lissajous", "frequencies": [10**9, 1, 1]},
        {"kind": "hold", "duration_s": 1e300},
    ],
    ids=str,
)
def test_what_nobody_can_mean_is_refused(wrong: dict[str, Any]) -> None:
    sound: dict[str, dict[str, Any]] = {
        "helix": {"center_mm": ORIGIN, "radius_mm": 5.0, "rise_mm": 5.0, "cycle_s": 10.0},
        "circle": {"center_mm": ORIGIN, "radius_mm": 5.0, "cycle_s": 10.0},
        "rectangle": {"center_mm": ORIGIN, "width_mm": 5.0, "height_mm": 5.0, "cycle_s": 10.0},
        "lissajous": {"center_mm": ORIGIN, "amplitude_mm": [5.0, 5.0, 5.0], "cycle_s": 10.0},
        "hold": {"position_mm": ORIGIN, "duration_s": 1.0},
    }
    kind = {"kind": wrong["kind"], **sound[wrong["kind"]]}
    load_trajectory_options(kind)
    with pytest.raises(OptionsError):
        load_trajectory_options({**kind, **wrong})


ORIGIN = [0.0, 0.0, 185.0]
