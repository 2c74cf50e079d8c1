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


MOUNTED = "serial: 3C112801, position_mm: [0.0, 0.0, -1.5], quaternion: [1.0, 0.01, 0.0, 0.0]"
SENSOR = ("attached_to: tip, port: 1, serial: 3C112801", f"attached_to: tip, port: 1, {MOUNTED}")
TOLD_PLACE = "position_mm: [0.0, 0.0, -1.5], quaternion: [-2.0, -0.02, 0.0, 0.0]"
BY_PORT = ("tip: {port: 1}", f"tip: {{port: 1, {TOLD_PLACE}}}")
BY_SERIAL = ("tip: {port: 1}", f"tip: {{serial: 3C112801, {TOLD_PLACE}}}")
ON_A_RIG = ("port: lab:aurora", "port: /dev/ttyUSB0")


@pytest.mark.parametrize("way", [("tip: {port: 1}", "tip: {serial: 3C112801}"), None])
def test_an_emulated_sensor_that_sits_elsewhere_than_the_tracker_is_told_is_warned_of(
    way: tuple[str, str] | None, tmp_path: Path
) -> None:
    (warning,) = warnings_of(tmp_path, SENSOR, *([way] if way else []))
    assert "sits 1.5 mm from where this says that it does, and is turned by 1.15°" in warning


@pytest.mark.parametrize("told", [BY_PORT, BY_SERIAL], ids=["port", "serial"])
def test_an_emulated_sensor_that_sits_where_the_tracker_is_told_is_not_warned_of(
    told: tuple[str, str], tmp_path: Path
) -> None:
    assert warnings_of(tmp_path, SENSOR, told) == []


def test_where_the_emulated_sensor_sits_says_nothing_of_a_rig(tmp_path: Path) -> None:
    assert warnings_of(tmp_path, SENSOR, ON_A_RIG) == []
