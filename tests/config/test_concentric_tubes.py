"""The concentric tubes' robot file: what tubes, carriages and axes must be to each other."""

from pathlib import Path

import numpy as np
import pytest

from config.emulation import ConcentricTubesPlant
from config.loader import load_robot
from daemon.robot.coupled_axes import CoupledAxes
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
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


@pytest.mark.parametrize("between", [0.0, 0.6, 1.2, -1.2, 2.4])
def test_where_the_coupled_limits_are_kept_no_tube_snaps(between: float) -> None:
    """Tube 3 turned round twice and back, drawn in as far as the limits allow it where it is."""
    robot = load_robot(TUBES).robot
    assert robot.emulation is not None
    assert isinstance(robot.emulation.plant, ConcentricTubesPlant)
    allowed = CoupledAxes.of(robot)
    guarded, careless = (ConcentricTubes(robot.emulation.plant) for _ in range(2))
    round_twice = np.linspace(0.0, 4.0 * np.pi, 121)
    snaps = 0
    for turned in [*round_twice, *round_twice[::-1]]:
        drawn_in, out = (np.array([0.0, between, turned, 0.0, mm]) for mm in (-53.0, -33.5))
        assert bool(allowed.inside(out))
        kept = drawn_in if bool(allowed.inside(drawn_in)) else out
        state = guarded.step(kept, TipLoad(), 0.1)
        assert state.snaps == 0
        assert state.stability > 0.05
        snaps = careless.step(drawn_in, TipLoad(), 0.1).snaps
    assert (snaps > 0) == (abs(between) < 1.5)


def test_the_defaults_are_the_shipped_tubes_but_for_their_zero() -> None:
    robot = load_robot(TUBES).robot
    assert robot.emulation is not None
    shipped = robot.emulation.plant
    assert isinstance(shipped, ConcentricTubesPlant)
    plain = ConcentricTubesPlant(kind="concentric_tubes")
    assert shipped.tubes[:2] == plain.tubes[:2]
    inner = plain.tubes[2].model_copy(update={"collar_mm": -67.5, "torsion_stiffness_n_mm2": 1.0})
    assert shipped.tubes[2].model_copy(update={"torsion_stiffness_n_mm2": 1.0}) == inner
