"""A robot file either gives a sound robot or says all that is wrong with it, line by line."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import pytest
import yaml

from config.axis import LinearStepper
from config.documents.problems import ConfigError
from config.loader import load_robot

SHIPPED = sorted(Path(str(files("config") / "robots")).glob("*.yaml"))
SOFT_ARM = Path(str(files("config") / "robots" / "soft_arm.yaml"))

Edit = Callable[[str], str]


def problems_of(tmp_path: Path, edit: Edit) -> list[str]:
    """The problems of the shipped soft arm after `edit`, without the file's name."""
    file = tmp_path / "robot.yaml"
    text = SOFT_ARM.read_text()
    edited = edit(text)
    assert edited != text
    file.write_text(edited)
    with pytest.raises(ConfigError) as raised:
        load_robot(file)
    return [str(problem).removeprefix(f"{file}:") for problem in raised.value.problems]


def swap(old: str, new: str) -> Edit:
    return lambda text: text.replace(old, new, 1)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.stem))
def test_every_shipped_robot_is_sound(path: Path) -> None:
    assert load_robot(path).robot.robot == path.stem


def test_the_soft_arm_has_six_chambers_on_six_nodes() -> None:
    robot = load_robot(SOFT_ARM).robot
    assert [axis.drive.node for axis in robot.axes] == [1, 2, 3, 4, 5, 6]
    assert all(isinstance(axis, LinearStepper) and axis.bore_mm for axis in robot.axes)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (
            swap("tracker_fault_after_s: 3.0", "tracker_fault_after_s: 0.1"),
            "supervision: tracker_hold_after_s (0.15 s) must be below tracker_fault_after_s (0.1",
        ),
        (
            swap("baud_rate: 115200", "baud_rate: 9600"),
            "tracker_hold_after_s: tracker.baud_rate 9600 brings a frame of 2 tools every 0.113 s: "
            "wait for 0.338 s or more, or use a faster line",
        ),
        (swap("baud_rate:", "baudrate:"), "tracker.baudrate: unknown key (did you mean 'baud_"),
        (swap("cycle_period_s", "cycle_perod_s"), "buses.can0.cycle_perod_s: unknown key (did"),
        (swap("    lead_mm", "    leed_mm"), "axes[0].leed_mm: unknown key (did you mean 'lead_mm"),
        (swap("bus: can0", "bus: cam0"), "axes[0].drive.bus: there is no bus 'cam0' (did you mean"),
        (swap("node: 3", "node: 2"), "axes[2].drive.node: axis 0 of node 2 on can0 is already"),
        (
            swap("node: 3", "node: 3, mode: csv, setpoint_timeout_s: 0.02"),
            "axes[2].drive.setpoint_timeout_s: must be at least 3 bus cycles: 0.03 s or more",
        ),
        (
            swap("master_heartbeat_timeout_s: 0.2", "master_heartbeat_timeout_s: 65.536"),
            "buses.can0.master_heartbeat_timeout_s: should be less than or equal to 65",
        ),
        (
            swap("node: 3", "node: 3, heartbeat_period_s: 0.0004"),
            "axes[2].drive.heartbeat_period_s: should be greater than or equal to 0.001",
        ),
        (swap("node: 3", "node: 127"), "axes[2].drive.node: 127 is the master's own node ID"),
        (swap("node: 3", "node: 128"), "axes[2].drive.node: should be less than or equal to 127"),
        (swap("name: distal_1", "name: proximal_1"), "axes[3].name: there is already an axis"),
        (swap("[0.0, 50.0]", "[50.0, 0.0]"), "axes[0].travel_mm: the lowest must come first"),
        (swap("[0.0, 50.0]", "[0.0, .inf]"), "axes[0].travel_mm[1]: should be a finite number"),
        (swap("lead_mm: 2.0", "lead_mm: two"), "axes[0].lead_mm: should be a valid number, not"),
        (swap("lead_mm: 2.0", "lead_mm: 2e0"), "axes[0].lead_mm: YAML reads 2e0 as text: write 2"),
        (swap("0.01 ", "0.0105 "), "buses.can0.cycle_period_s: must be whole milliseconds"),
        (swap("kind: linear_stepper", "kind: stepper"), "axes[0].kind: must be one of 'linear_"),
        (swap("stepper.eds", "steper.eds"), "axes[0].drive.eds: there is no file"),
        (swap("tip: {port: 1}", "tpi: {port: 1}"), "tracker.tools: there must be a 'tip', the"),
        (swap("tip: {port: 1}", "tip: {port: 9}"), "tracker.tools.tip: no such tool in emulation"),
        (swap("tip: {port: 1}", "tip: {}"), "tracker.tools.tip: say either serial or port"),
        (swap("base: {port: 2}", "base: {port: 1}"), "tracker.tools.base: is the same sensor as"),
        (swap("connection_lost: quick_stop", "connection_lost: off"), "YAML reads off as false"),
        (swap("bore_mm: 25.0", "bore_mm: 26.0"), "axes[0].bore_mm: pushes 26.5 mL out of emulat"),
        (swap("port: 2, serial", "port: 1, serial"), "emulation.tracker.tools[1].port: this port"),
    ],
)
def test_each_mistake_is_named_with_its_place(tmp_path: Path, edit: Edit, expected: str) -> None:
    assert any(expected in problem for problem in problems_of(tmp_path, edit))


def test_all_problems_come_at_once_and_in_the_order_of_the_file(tmp_path: Path) -> None:
    def spoil(text: str) -> str:
        return (
            text.replace("baud_rate: 115200", "baud_rate: 115201")
            .replace("bitrate_bit_s: 1_000_000", "bitrate_bit_s: 1e6")
            .replace("bus: can0", "bus: can1")
            .replace("lead_mm", "lead_m", 1)
            .replace("seed: 1", "seed: 1\n  seed: 2")
        )

    found = problems_of(tmp_path, spoil)
    lines = [int(problem.split(":")[0]) for problem in found]
    assert lines == sorted(lines)
    for part in ("115201", "1e6", "'can1'", "lead_mm: this key", "lead_m: unknown", "stands twice"):
        assert any(part in problem for problem in found), part


@pytest.mark.parametrize("text", ["", "3", "[]", "robot: x", "axes: 3\nbuses: [1]\ntracker: x"])
def test_a_file_of_another_shape_is_refused_with_reasons(tmp_path: Path, text: str) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError):
        load_robot(file)


def test_a_missing_or_unreadable_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        load_robot(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"a: \xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8 text: byte 3"):
        load_robot(tmp_path / "binary.yaml")


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (swap("[0.0, 50.0]", "[0.0, 5.0e+9]"), "axes[0].travel_mm: 5e+09 is "),
        (swap("[0.0, 50.0]", "[-5.0e+9, 50.0]"), "axes[0].travel_mm: -5e+09 is -"),
        (swap("error_mm: 1.0", "error_mm: 5.0e+9"), "axes[0].following_error_mm: "),
        (
            swap("max_velocity_mm_s: 10.0", "max_velocity_mm_s: 5.0e+9"),
            "axes[0].max_velocity_mm_s: is",
        ),
        (
            swap("max_acceleration_mm_s2: 100.0", "max_acceleration_mm_s2: 5.0e+9"),
            "axes[0].max_acceleration_mm_s2: is ",
        ),
        (
            swap("deceleration_mm_s2: 200.0", "deceleration_mm_s2: 5.0e+9"),
            "axes[0].quick_stop_deceleration_mm_s2: is ",
        ),
    ],
)
def test_what_does_not_fit_into_the_drives_32_bits_is_found(
    tmp_path: Path, edit: Edit, expected: str
) -> None:
    problems = problems_of(tmp_path, edit)
    assert any(expected in problem and "32 bits" in problem for problem in problems), problems


def in_order(order: str, homing: str = "") -> Edit:
    """The soft arm with a homing order; and with something said of the homing of all axes."""

    def edit(text: str) -> str:
        text = text.replace("    lead_mm: 2.0", f"{homing}    lead_mm: 2.0", 1)
        return f"{text}\nhoming_order: {order}\n"

    return edit


AT_START = "    homing: {referenced: home_at_start}\n"


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (in_order("[[proximal_1, proximl_2]]"), "homing_order[0][1]: there is no axis 'proximl_2'"),
        (
            in_order("[[proximal_1], [proximal_1]]"),
            "homing_order[1][0]: 'proximal_1' has a place in the order already",
        ),
        (
            in_order("[[proximal_1]]", AT_START),
            "homing_order: 'proximal_2' must be homed, and has no place in the order",
        ),
        (in_order("[[]]"), "homing_order[0]: "),
        (in_order("proximal_1"), "homing_order: "),
        (
            in_order("[[proximal_1]]", "    homing: {referenced: perhaps}\n"),
            "axes[0].homing.referenced: ",
        ),
        (
            in_order("[[proximal_1]]", "    homing: {referenced_bit: 4}\n"),
            "axes[0].homing.referenced_bit: ",
        ),
    ],
)
def test_an_order_of_homing_that_cannot_be_kept_is_found(
    tmp_path: Path, edit: Edit, expected: str
) -> None:
    problems = problems_of(tmp_path, edit)
    assert any(expected in problem for problem in problems), problems


def test_axes_are_homed_one_after_the_other_where_no_order_is_given(tmp_path: Path) -> None:
    robot = load_robot(SOFT_ARM).robot
    assert robot.homing_groups == [[axis.name] for axis in robot.axes]
    file = tmp_path / "robot.yaml"
    every = ", ".join(axis.name for axis in robot.axes)
    file.write_text(in_order(f"[[{every}]]", AT_START)(SOFT_ARM.read_text()))
    assert load_robot(file).robot.homing_groups == [[axis.name for axis in robot.axes]]


def test_a_slow_line_wants_patience_of_all_who_wait_for_frames(tmp_path: Path) -> None:
    """Who takes the baud rate of a tracker that was just switched on is told all at once."""
    slow = ("baud_rate: 115200", "baud_rate: 9600")
    problems = problems_of(tmp_path, lambda text: text.replace(*slow))
    keys = [one.split(": ")[1] for one in problems]
    waiting = ["supervision.tracker_quality", "supervision.tracker_hold_after_s"]
    assert sorted(keys) == sorted(["pose_filter.predict_for_s", *waiting])
    patient = ("tracker_hold_after_s: 0.15", "tracker_quality: 0.2\n  tracker_hold_after_s: 0.34")
    text = SOFT_ARM.read_text()
    for old, new in (slow, patient):
        text = text.replace(old, new)
    (tmp_path / "robot.yaml").write_text(text + "\npose_filter: {predict_for_s: 0.23}\n")
    assert load_robot(tmp_path / "robot.yaml").robot.tracker.frames_apart_s > 0.1


@pytest.mark.parametrize("more", [{"baud_rate": 38400}, {"frame_rate": "fast"}])
def test_a_line_that_brings_nearly_all_frames_needs_no_other_settings(
    tmp_path: Path, more: dict[str, object]
) -> None:
    value = yaml.safe_load(SOFT_ARM.read_text())
    value["tracker"].update(more)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(value))
    load_robot(tmp_path / "robot.yaml")


def test_text_takes_a_line_for_longer_than_binary_does(tmp_path: Path) -> None:
    slow = ("baud_rate: 115200", "baud_rate: 38400\n  reply_format: text")
    (problem,) = problems_of(tmp_path, lambda text: text.replace(*slow))
    assert "supervision.tracker_quality: " in problem
    assert "every 0.043 s, a share of 0.582 of all" in problem
