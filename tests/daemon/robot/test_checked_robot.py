"""What a robot file's warnings tell an operator, beside all that is refused."""

from pathlib import Path

import pytest

from daemon.robot.checked_robot import check_robot
from tests import SHIPPED_ROBOTS, SOFT_ARM

FAST = ("tracker:\n  port: lab:aurora", "tracker:\n  frame_rate: fast\n  port: lab:aurora")
RIG = ("tracker:\n  port: lab:aurora", "tracker:\n  frame_rate: fast\n  port: /dev/ttyUSB0")
NOISY = ("  tracker:\n    tools:", "  tracker:\n    jitter_mm: 0.3\n    tools:")
TOLD = "pose_filter: {position_noise_mm: 0.5}\n"


def warnings_of(folder: Path, *changes: tuple[str, str], more: str = "") -> list[str]:
    text = SOFT_ARM.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "robot.yaml").write_text(text + more)
    return [warning.message for warning in check_robot(folder / "robot.yaml").warnings]


@pytest.mark.parametrize("robot", sorted(SHIPPED_ROBOTS.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_robots_have_no_warning(robot: Path) -> None:
    assert check_robot(robot).warnings == []


@pytest.mark.parametrize("change", [FAST, RIG, NOISY], ids=["fast", "fast_rig", "noisy"])
def test_noise_that_the_filter_is_not_told_of_is_warned_of_with_the_remedy(
    change: tuple[str, str], tmp_path: Path
) -> None:
    (warning,) = warnings_of(tmp_path, change)
    assert "pose_filter: {position_noise_mm: 0.4}" in warning


@pytest.mark.parametrize("change", [FAST, RIG, NOISY], ids=["fast", "fast_rig", "noisy"])
def test_who_has_told_the_filter_of_the_noise_is_not_warned(
    change: tuple[str, str], tmp_path: Path
) -> None:
    assert warnings_of(tmp_path, change, more=TOLD) == []
