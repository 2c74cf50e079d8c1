"""The concentric tubes' robot file: what tubes, carriages and axes must be to each other."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from config.emulation.plants import ConcentricTubesPlant, Tube
from config.loader import load_robot
from config.robot import Robot
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes, variation
from sim_backends.plants.plant import TipLoad
from tests import SHIPPED_ROBOTS
from tests.config.edited import problems_of

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "  - {<<: *rotation, name: rotation_3, drive: {<<: *drive, node: 3}}\n",
            "",
            "axes: 4 axes cannot move the 3 tubes and 2 carriages of emulation.plant",
        ),
        (
            "{<<: *carriage, name: carriage_inner, drive: {<<: *drive, node: 5}, "
            "travel_mm: [-43.5, 23.5],\n     homing_position_mm: 24.84}",
            "{<<: *rotation, name: carriage_inner, drive: {<<: *drive, node: 5}}",
            "axes[4].kind: must be a tube_translation: the tubes' axes come first",
        ),
        (
            "    holds_without_power: true\n    following_error_rad",
            "    following_error_rad",
            "axes[0].holds_without_power: a tube must not be let go: use a gear, a screw or a",
        ),
        (
            "holds_without_power: true   # a screw",
            "holds_without_power: false   # a screw",
            "axes[4].holds_without_power: a tube must not be let go",
        ),
        (
            "following_error_rad: 0.08",
            "following_error_rad: 0.05",
            "axes[0].following_error_rad: a target is up to 0.055 rad ahead of where the axis was",
        ),
        (
            "collar_mm: -17.0",
            "collar_mm: 0.0",
            "tubes[1].collar_mm: must be behind the collar of the tube round it",
        ),
        (
            "outer_radius_mm: 1.2",
            "outer_radius_mm: 1.5",
            "tubes[1].outer_radius_mm: must be less than that of the tube round it",
        ),
        (
            "{carriage: 0, collar_mm: 0.0",
            "{carriage: 0, collar_mm: 1.0",
            "tubes[0].collar_mm: the mouth is the first collar",
        ),
        (
            "{carriage: 1, collar_mm: -67.5",
            "{carriage: 2, collar_mm: -67.5",
            "emulation.plant.tubes: carriages are numbered from 0 without a gap, not [0, 2]",
        ),
        (
            "\n         quaternion: [1.0, 0.008, 0.006, 0.0]",
            "\n         quaternion: [0.0, 0.0, 0.0, 0.0]",
            "emulation.tracker.tools[0].quaternion: zero is no rotation",
        ),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, old: str, new: str, expected: str) -> None:
    problems = problems_of(tmp_path, TUBES, (old, new))
    assert any(expected in problem for problem in problems), problems


def test_wherever_the_drives_go_alone_no_collar_meets_another_and_no_end_is_drawn_in() -> None:
    """The box of the axes' travels is free of collisions without anybody who watches them."""
    robot = load_robot(TUBES).robot
    assert robot.emulation is not None
    assert isinstance(robot.emulation.plant, ConcentricTubesPlant)
    tubes = robot.emulation.plant.tubes
    ends_mm = [tube.collar_mm + sum(s.length_mm for s in tube.sections) for tube in tubes]
    pair, inner = (axis.travel for axis in robot.axes[3:])
    for pair_mm in pair:
        for inner_mm in inner:
            assert tubes[1].collar_mm + pair_mm - (tubes[2].collar_mm + inner_mm) >= 17.0
            assert ends_mm[2] + inner_mm >= ends_mm[0] + pair_mm


LOWEST_OUT_MM = 25.0
ROUND_TWICE = np.linspace(0.0, 4.0 * np.pi, 121)


def made_so(robot: Robot, curvature: float, stiffness: tuple[float, ...]) -> ConcentricTubesPlant:
    """The tubes with all curvatures, and each one's stiffness, off by so much of them."""
    plant = plant_of(robot)

    def off(tube: Tube, stiffer: float) -> Tube:
        bent = 1.0 + curvature
        sections = [
            one.model_copy(update={"curvature_per_mm": bent * one.curvature_per_mm})
            for one in tube.sections
        ]
        return tube.model_copy(
            update={
                "sections": tuple(sections),
                "bending_stiffness_n_mm2": (1.0 + stiffer) * tube.bending_stiffness_n_mm2,
                "torsion_stiffness_n_mm2": (1.0 + stiffer) * tube.torsion_stiffness_n_mm2,
            }
        )

    tubes = (off(tube, one) for tube, one in zip(plant.tubes, stiffness, strict=True))
    return plant.model_copy(update={"tubes": tuple(tubes)})


def plant_of(robot: Robot) -> ConcentricTubesPlant:
    assert robot.emulation is not None
    assert isinstance(robot.emulation.plant, ConcentricTubesPlant)
    return robot.emulation.plant


def turned_round(
    plant: ConcentricTubesPlant, between: float, kept: Callable[[Vector], bool], out_mm: float
) -> tuple[int, float]:
    """How often tubes snap that tube 3 is turned round in, twice and back, drawn in to 0.5 mm where
    that is `kept` and to out_mm elsewhere; and their least stability."""
    tubes, snaps, stability = ConcentricTubes(plant), 0, 1.0
    for turned in [*ROUND_TWICE, *ROUND_TWICE[::-1]]:
        drawn_in, out = (np.array([0.0, between, turned, 0.0, mm - 53.5]) for mm in (0.5, out_mm))
        state = tubes.step(drawn_in if kept(drawn_in) else out, TipLoad(), 0.1)
        snaps, stability = state.snaps, min(stability, state.stability)
    return snaps, stability


@pytest.mark.parametrize("between", [0.0, 0.6, 1.2, -1.2, 2.4])
def test_where_the_coupled_limits_are_kept_no_tube_snaps(between: float) -> None:
    """Tube 3 turned round, drawn in as far as the limits allow it where it is."""
    robot = load_robot(TUBES).robot
    allowed = CoupledAxes.of(robot)

    def kept(u: Vector) -> bool:
        return bool(allowed.inside(u))

    assert kept(np.array([0.0, between, np.pi, 0.0, LOWEST_OUT_MM - 53.5]))
    snaps, stability = turned_round(plant_of(robot), between, kept, LOWEST_OUT_MM)
    assert snaps == 0
    assert stability > 0.05
    careless, _ = turned_round(plant_of(robot), between, lambda _: True, LOWEST_OUT_MM)
    assert (careless > 0) == (abs(between) < 1.5)


WORST = (0.06, (0.05, 0.05, -0.05))
"""Of all that `variation` may give: that which snaps with most of tube 3 standing out."""


@pytest.mark.parametrize("body", [WORST, 176, 119, 179, *range(1, 9)], ids=str)
def test_no_tube_of_a_body_that_is_made_a_little_otherwise_snaps_either(
    body: int | tuple[float, tuple[float, ...]],
) -> None:
    """Curvatures 6 % and stiffnesses 5 % off for the worse; the worst three of 200 at random."""
    robot = load_robot(TUBES).robot
    allowed = CoupledAxes.of(robot)
    plant = variation(plant_of(robot), body) if isinstance(body, int) else made_so(robot, *body)
    for between in (0.0, 0.3, 1.0, -1.5):
        found = turned_round(plant, between, lambda u: bool(allowed.inside(u)), LOWEST_OUT_MM)
        assert found[0] == 0
        assert found[1] > 0.04


def test_with_5_mm_less_than_the_guard_asks_for_the_worst_body_snaps() -> None:
    """Where the tubes as they are meant are still far from it."""
    robot = load_robot(TUBES).robot
    nominal, worst = plant_of(robot), made_so(robot, *WORST)
    for plant, out_mm, snap in (
        (nominal, 20.0, False),
        (worst, 20.0, True),
        (worst, LOWEST_OUT_MM, False),
    ):
        assert (turned_round(plant, 0.0, lambda _: False, out_mm)[0] > 0) == snap


def test_the_defaults_are_the_shipped_tubes_but_for_their_zero() -> None:
    robot = load_robot(TUBES).robot
    assert robot.emulation is not None
    shipped = robot.emulation.plant
    assert isinstance(shipped, ConcentricTubesPlant)
    plain = ConcentricTubesPlant(kind="concentric_tubes")
    assert shipped.tubes[:2] == plain.tubes[:2]
    inner = plain.tubes[2].model_copy(update={"collar_mm": -67.5, "torsion_stiffness_n_mm2": 1.0})
    assert shipped.tubes[2].model_copy(update={"torsion_stiffness_n_mm2": 1.0}) == inner
