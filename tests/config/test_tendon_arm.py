"""The tendon-driven arm's robot file: what its tendons and its axes must be to each other."""

from pathlib import Path

import pytest

from config.axis import TendonMotor
from config.documents.problems import ConfigError
from config.emulation.plants import TendonArmPlant
from config.loader import load_robot
from drivers.axis_scale import axis_scale
from tests import SHIPPED_ROBOTS
from tests.config.edited import problems_of

TENDON_ARM = SHIPPED_ROBOTS / "tendon_arm.yaml"


def test_the_shipped_arm_has_a_motor_for_every_tendon_and_torque_to_spare() -> None:
    robot = load_robot(TENDON_ARM).robot
    assert robot.emulation is not None
    plant = robot.emulation.plant
    assert isinstance(plant, TendonArmPlant)
    assert len(robot.axes) == len(plant.tendons) == 4
    for axis in robot.axes:
        assert isinstance(axis, TendonMotor)
        assert axis.min_tension_n < plant.pretension_n < axis.max_tension_n
        stalls_at_n = axis_scale(axis).force(axis.drive.max_torque_permille)
        assert 1.1 * axis.max_tension_n < stalls_at_n


def test_middle_of_travel_is_the_straight_arm() -> None:
    """Where controllers draw redundant axes to, unless told otherwise."""
    for axis in load_robot(TENDON_ARM).robot.axes:
        assert isinstance(axis, TendonMotor)
        assert sum(axis.travel_mm) == 0.0


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "min_tension_n: 0.1 ",
            "min_tension_n: 2.5 ",
            "axes[0].min_tension_n: emulation.plant.pretension_n, 2 N, must lie between",
        ),
        (
            "  - {<<: *straight, name: straight_3, drive: {<<: *drive, node: 3}}\n",
            "",
            "axes: 3 axes cannot pull the 4 tendons of emulation.plant",
        ),
        (
            "kind: tendon_arm",
            "kind: tendon_arm\n    gravity_direction: [0.0, 0.0, 0.0]",
            "emulation.plant.gravity_direction: zero has no direction",
        ),
        (
            "kind: tendon_arm",
            "kind: tendon_arm\n    pretension_n: 0.0",
            "emulation.plant.pretension_n: should be greater than 0",
        ),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, old: str, new: str, expected: str) -> None:
    problems = problems_of(tmp_path, TENDON_ARM, (old, new))
    assert any(expected in problem for problem in problems), problems


def test_a_motor_that_has_no_spool_cannot_pull_a_tendon(tmp_path: Path) -> None:
    text = TENDON_ARM.read_text()
    lines = [
        line
        for line in text.replace("tendon_motor", "tube_translation").splitlines()
        if not line.strip().startswith(("min_tension_n", "max_tension_n", "spool_radius"))
    ]
    file = tmp_path / "robot.yaml"
    screws = "\n".join(lines).replace(
        "gear_ratio: 5.0", "gear_ratio: 5.0\n    lead_mm: 2.0\n    holds_without_power: true"
    )
    file.write_text(screws.replace(", max_tension_n: 16.8", ""))
    with pytest.raises(ConfigError) as raised:
        load_robot(file)
    texts = [str(problem) for problem in raised.value.problems]
    assert len(texts) == 4
    assert all("a tendon_arm is moved by tendon_motor axes" in text for text in texts)
