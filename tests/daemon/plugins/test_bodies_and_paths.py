"""Plants and trajectories of packages: as good as ours where they are, and named where not."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from config.documents.kinds import API_VERSION, KindError
from config.loader import load_robot
from config.tasks.trajectory import load_trajectory_options
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION
from daemon.commands.terminal.command_line import main
from daemon.host.clock import MonotonicClock
from daemon.messages import Acquire, Load
from daemon.reference.trajectories import make_trajectory
from sim_backends.lab.bodies import LabError, another_body
from sim_backends.lab.lab import Lab
from tests import SOFT_ARM
from tests.daemon.plugins.packages import (
    OPTIONS,
    controller_package,
    path_package,
    plant_package,
)
from tests.daemon.service.rig import Rig, on_a_rig
from tests.installed_package import installed, write_package

PATH_OF = "the trajectory 'mine' of other_people 1.2"
BODY_OF = "the plant 'mine' of other_people 1.2"
MINE = {"kind": "mine", "cycle_s": 4.0}
AWAY = "return np.array([2.0 * t_s, 0.0, 190.0]), np.array([2.0, 0.0, 0.0])"
"""Of a path that leads away, at 2 mm/s."""


def robot_with(tmp_path: Path, plant: dict[str, object]) -> Path:
    """The shipped arm with another body."""
    values = yaml.safe_load(SOFT_ARM.read_text())
    values["emulation"]["plant"] = plant
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


# Trajectories.


def test_a_path_is_followed_as_the_package_has_it(tmp_path: Path) -> None:
    with installed(path_package(tmp_path)):
        options = load_trajectory_options({**MINE, "cycles": 3})
        trajectory = make_trajectory(options, tmp_path)
    assert (trajectory.kind, trajectory.duration_s) == ("mine", 12.0)
    rate = np.pi / 2.0
    for t_s in np.linspace(0.0, 11.999, 77):
        place, velocity = trajectory.at(float(t_s))
        assert place == pytest.approx([10.0 * np.sin(rate * t_s), 0.0, 190.0], abs=1e-6)
        assert velocity == pytest.approx([10.0 * rate * np.cos(rate * t_s), 0.0, 0.0], abs=1e-3)


def test_a_path_that_does_not_end_where_it_begins_is_not_repeated(tmp_path: Path) -> None:
    with installed(path_package(tmp_path, AWAY)):
        once = load_trajectory_options(MINE)
        assert make_trajectory(once, tmp_path).cycles == 1
        twice = load_trajectory_options({**MINE, "cycles": 2})
        with pytest.raises(ValueError, match=r"2 times: its end is 8.00 mm away"):
            make_trajectory(twice, tmp_path)


def test_nothing_of_the_package_runs_while_it_is_followed(tmp_path: Path) -> None:
    """It has been asked for everything before."""
    with installed(path_package(tmp_path, "print(end='.')")):
        trajectory = make_trajectory(load_trajectory_options(MINE), tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("builtins.print", lambda **_: pytest.fail("it was asked again"))
        trajectory.at(1.2345)


BAD_PATHS = {
    "raises": ("raise OverflowError('far')", "OverflowError: far"),
    "not a number": ("return np.full(3, np.nan), np.zeros(3)", "it gives what is not a number"),
    "wrong shape": ("return np.zeros(2), np.zeros(3)", "it gives shapes (2,) and (3,)"),
    "no pair": ("return 3", "'int' object is not iterable"),
    "too far": ("return np.full(3, 1e6), np.zeros(3)", "farther away than 10000 mm"),
    "backwards": (AWAY.replace("[2.0, 0", "[-2.0, 0"), "and its places change by (2, 0, 0)"),
    "in metres": (AWAY.replace("[2.0, 0", "[0.002, 0"), "it gives a velocity of (0.002, 0, 0)"),
    "leaps": (AWAY.replace("t_s,", "t_s + 5.0 * (t_s > 1.0),"), "at 1 s its places leap by 5"),
    "leaps between": (AWAY.replace("t_s,", "t_s + 5.0 * (t_s > 1.005),"), "change by (502, 0"),
    "only late": ("if t_s > 3.0: raise KeyError(t_s)", "KeyError: "),
}


@pytest.mark.parametrize(("at", "told"), BAD_PATHS.values(), ids=list(BAD_PATHS))
def test_a_path_that_is_none_is_refused_before_anything_moves(
    at: str, told: str, tmp_path: Path
) -> None:
    async def story(rig: Rig) -> None:
        await rig.do(Acquire)
        refusal = await rig.refused(Load, trajectory=MINE, controller={"kind": "broyden"})
        assert refusal.name == "bad_trajectory"
        assert refusal.text.startswith(f"{PATH_OF} failed: ")
        assert told in refusal.text

    with installed(path_package(tmp_path, at)):
        on_a_rig(story)


def test_a_corner_that_a_package_has_not_declared_is_no_contradiction(tmp_path: Path) -> None:
    zigzag = """
        leg, along = divmod(t_s + 0.005, 0.777)
        sign = 1.0 if leg % 2 else -1.0
        x = 10.0 * sign * (along - 0.777 / 2.0)
        return np.array([x, 0.0, 190.0]), np.array([10.0 * sign, 0.0, 0.0])
    """
    with installed(path_package(tmp_path, zigzag)):
        make_trajectory(load_trajectory_options(MINE), tmp_path)


def test_what_is_no_cycle_is_refused(tmp_path: Path) -> None:
    maker = "def make(options, base, cycles):\n    return 7\n"
    with (
        installed(path_package(tmp_path, maker=maker)),
        pytest.raises(KindError, match=r"it made no Cycle, but 7"),
    ):
        make_trajectory(load_trajectory_options(MINE), tmp_path)


# Plants.


def test_a_body_of_a_package_stands_in_the_lab(tmp_path: Path) -> None:
    path = robot_with(tmp_path, {"kind": "mine", "length_mm": 120.0})
    with installed(plant_package(tmp_path / "site")):
        robot = load_robot(path).robot
        assert robot.emulation is not None
        body = Lab(robot, path, MonotonicClock()).body
        body.advance(50_000_000)
        assert body.record.plant_failures == 0
        assert body.record.state.radius_mm == 5.0
        assert robot.emulation.plant.extent([0.0] * 6).length_mm == 120.0
        with pytest.raises(LabError, match="has no other bodies of its design"):
            another_body(robot.emulation, 3)


BAD_BODIES = {
    "raises": ("raise ZeroDivisionError('stiffness')", "ZeroDivisionError: stiffness"),
    "nothing": ("return None", "it gave no BodyState, but None"),
    "not a number": (
        "state = state._replace(actuator_forces=np.full(6, np.inf))",
        "its force is not a number",
    ),
    "forces of five": (
        "state = state._replace(actuator_forces=np.zeros(5))",
        "its actuator_forces have the shape (5,)",
    ),
    "no line": ("state = state._replace(centreline_mm=line[:1])", "its centreline has the shape"),
}


@pytest.mark.parametrize(("step", "told"), BAD_BODIES.values(), ids=list(BAD_BODIES))
def test_a_body_that_fails_stays_as_it_was_and_the_diary_says_whose_it_is(
    step: str, told: str, tmp_path: Path
) -> None:
    path = robot_with(tmp_path, {"kind": "mine"})
    with installed(plant_package(tmp_path / "site", step)):
        lab = Lab(load_robot(path).robot, path, MonotonicClock())
        for moment in range(1, 30):
            lab.body.advance(moment * 25_000_000)
    assert lab.body.record.plant_failures > 10
    noted = [text for _, text in lab.diary.after(0)]
    assert len(noted) == 1
    assert noted[0].startswith(f"the body stays as it is: {BODY_OF} failed: ")
    assert told in noted[0]


def test_a_body_for_other_axes_is_refused(tmp_path: Path) -> None:
    path = robot_with(tmp_path, {"kind": "mine"})
    with (
        installed(plant_package(tmp_path / "site", count="4")),
        pytest.raises(LabError, match="it has 4 actuators, and the robot 6 axes"),
    ):
        Lab(load_robot(path).robot, path, MonotonicClock())


# In files and at the terminal.


def test_a_mistake_in_its_options_is_told_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiment: mine\nrobot: builtin:soft_arm\n"
        "trajectory: {kind: mine, cycle_s: 4, hieght_mm: 3}\n"
        "controller:\n  kind: miine\n"
    )
    with installed(path_package(tmp_path / "site")):
        assert main(["check", str(path)]) == EXIT_CONFIGURATION
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith(
        f"{path}:3:38: trajectory.hieght_mm: unknown key (did you mean 'height_mm'?)"
    )
    assert told[1].startswith(f"{path}:5:9: controller.kind: must be one of 'broyden', ")


def test_the_options_of_a_broken_package_are_told_with_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiment: mine\nrobot: builtin:soft_arm\n"
        "trajectory: {kind: hold, position_mm: [0, 0, 180], duration_s: 1}\n"
        "controller: {kind: mine}\n"
    )
    with installed(controller_package(tmp_path / "site", options="import nowhere")):
        assert main(["check", str(path)]) == EXIT_CONFIGURATION
        whose = "the controller 'mine' of other_people 1.2"
        assert capsys.readouterr().err == (
            f"{path}:4:20: controller.kind: {whose} cannot be imported: "
            "ModuleNotFoundError: No module named 'nowhere'\n"
        )
        assert main(["plugins"]) == 1
        assert "cannot be" in capsys.readouterr().out


def test_a_package_s_own_check_that_fails_is_told_with_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiment: mine\nrobot: builtin:soft_arm\n"
        "trajectory: {kind: hold, position_mm: [0, 0, 180], duration_s: 1}\n"
        "controller: {kind: mine}\n"
    )
    gain = "    gain: float = 1.0\n"
    check = f"{gain}\n    def model_post_init(self, _):\n        {{}}['no such key']\n"
    options = OPTIONS.replace(gain, check)
    with installed(controller_package(tmp_path / "site", options=options)):
        assert main(["check", str(path)]) == EXIT_CONFIGURATION
    whose = "the controller 'mine' of other_people 1.2"
    assert capsys.readouterr().err == (
        f"{path}:4:20: controller.kind: {whose} cannot check its options: KeyError: 'no such key'\n"
    )


def test_what_is_installed_is_listed_with_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with installed(controller_package(tmp_path)):
        assert main(["plugins", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["schema"] == "tentacled.plugins/1"
    assert listed["result"]["api_version"] == API_VERSION
    by_name = {(one["group"], one["name"]): one for one in listed["result"]["kinds"]}
    mine = by_name["tentacled.controllers", "mine"]
    assert (mine["source"], mine["options"]) == ("other_people 1.2", "Goes nowhere")
    assert by_name["tentacled.plants", "soft_arm"]["problem"] == ""
    ours = {group for group, name in by_name if name != "mine"}
    assert ours == {"tentacled.controllers", "tentacled.plants", "tentacled.trajectories"}
    assert by_name["tentacled.trajectories", "planned"]["source"] == "tentacled"


def test_a_name_of_ours_stays_ours_and_one_of_two_packages_is_nobodys(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = {"tentacled.controllers": {"broyden": "one.kinds:MINE", "mine": "one.kinds:MINE"}}
    one = write_package(tmp_path / "1", "one", {"kinds": OPTIONS}, points)
    points = {"tentacled.controllers": {"mine": "two.kinds:MINE"}}
    two = write_package(tmp_path / "2", "two", {"kinds": OPTIONS}, points)
    with installed(one, two):
        assert main(["plugins", "--json"]) == 1
        kinds = json.loads(capsys.readouterr().out)["result"]["kinds"]
    problems = {(kind["name"], kind["source"]): kind["problem"] for kind in kinds}
    assert problems["broyden", "tentacled"] == ""
    assert problems["broyden", "one 1.2"] == "tentacled has one of this name, which is used"
    both = problems["mine", "one 1.2, two 1.2"]
    assert both.endswith("several packages have one of this name; uninstall the others")


def test_an_experiment_with_one_runs_to_its_report(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiment: mine\nrobot: builtin:soft_arm\nlongest_s: 60\n"
        "trajectory: {kind: mine, cycle_s: 8, height_mm: 178}\n"
        "controller: {kind: constant_curvature}\n"
    )
    out = tmp_path / "out"
    with installed(path_package(tmp_path / "site")):
        assert main(["experiment", str(path), "--out", str(out)]) == 0
    assert json.loads((out / "result.json").read_text())["trajectory"] == "mine"
