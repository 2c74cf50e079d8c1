"""`tentacled check`: what it passes can be built, what cannot is explained with its place."""

from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION
from daemon.commands.terminal.command_line import main
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.experiments.check_mutations import try_many

CONFIG = SHIPPED_ROBOTS.parent
FEW = 25


def checked(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(["check", str(path)])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_several_files_are_checked_at_once_and_the_problems_of_all_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = []
    for name in ("one.yaml", "other.yaml"):
        broken.append(tmp_path / name)
        broken[-1].write_text(SOFT_ARM.read_text().replace("lead_mm", "leed_mm"))
    code = main(["check", str(broken[0]), str(SOFT_ARM), str(broken[1])])
    told = capsys.readouterr()
    assert code == EXIT_CONFIGURATION
    assert f"{SOFT_ARM}: soft_arm is sound" in told.out
    assert all(str(path) in told.err for path in broken)
    assert main(["check", str(SOFT_ARM), "builtin:chest_circle"]) == 0
    assert capsys.readouterr().out.count("is sound") == 2


def test_what_only_the_gate_keeps_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = checked(SHIPPED_ROBOTS / "concentric_tubes.yaml", capsys)
    assert "collar_clearance: the gate keeps it; drives alone reach 0.5 mm beyond it" in out
    assert "snap_guard: the gate keeps it; drives alone reach 25 mm beyond it" in out


def test_a_soft_arm_of_three_axes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "three.yaml"
    lines = SOFT_ARM.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if "name: distal_" not in line))
    code, out, err = checked(path, capsys)
    assert (code, out) == (EXIT_CONFIGURATION, "")
    assert "axes: 3 axes cannot fill the 6 chambers of emulation.plant" in err


@pytest.mark.parametrize(
    ("shipped_line", "own_line", "key", "why"),
    [
        ("mesh: builtin:one_segment_post.stl", "mesh: own.stl", "risk.surface", "is empty"),
        (
            "model: builtin:one_segment_arm.npz",
            "model: builtin:soft_arm.npz",
            "risk.model",
            "'soft",
        ),
    ],
)
def test_what_the_risk_cannot_be_told_with_is_found_where_it_is_named(
    shipped_line: str,
    own_line: str,
    key: str,
    why: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "own.stl").touch()
    path = tmp_path / "arm.yaml"
    text = (SHIPPED_ROBOTS / "one_segment_arm.yaml").read_text()
    path.write_text(text.replace(shipped_line, own_line))
    code, out, err = checked(path, capsys)
    assert (code, out) == (EXIT_CONFIGURATION, "")
    assert f": {key}: " in err
    assert why in err
    line = int(err.removeprefix(f"{path}:").split(":")[0])
    assert "\n".join(path.read_text().splitlines()[line - 2 : line]).count(own_line) == 1


def test_an_experiment_without_its_waypoints_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "lost.yaml"
    path.write_text(
        "experiment: lost\nrobot: builtin:soft_arm\ncontroller: {kind: broyden}\n"
        "trajectory: {kind: waypoints, file: nowhere.csv}\n"
    )
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert err.startswith(f"{path}:4:13: trajectory: ")
    assert f"{tmp_path / 'nowhere.csv'}: No such file" in err
    assert main(["experiment", str(path), "--out", str(tmp_path / "out")]) == EXIT_CONFIGURATION
    assert "nowhere.csv" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("longest", "line"), [("longest_s: 4\n", 5), ("", 1)])
def test_a_trajectory_that_takes_longer_than_the_experiment_may_is_explained(
    longest: str, line: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "long.yaml"
    path.write_text(
        "experiment: long\nrobot: builtin:soft_arm\ncontroller: {kind: broyden}\n"
        f"trajectory: {{kind: hold, position_mm: [0, 0, 185], duration_s: 7200}}\n{longest}"
    )
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert err.startswith(f"{path}:{line}:")
    assert "longest_s: the trajectory takes 7200 s" in err


def test_a_controller_that_does_not_fit_the_robot_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "unfit.yaml"
    path.write_text(
        "experiment: unfit\nrobot: builtin:tendon_arm\ncontroller: {kind: constant_curvature}\n"
        "trajectory: {kind: hold, position_mm: [0.0, 0.0, 190.0], duration_s: 1.0}\n"
    )
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert err.startswith(f"{path}:3:13: controller: ")


def test_a_fault_that_there_is_not_is_explained_in_a_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "strange.yaml"
    path.write_text("scenario: strange\nevents:\n  - {at_s: 1.0, inject: tracker.mising=1s}\n")
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert "events[0].inject" in err
    assert "did you mean 'missing'" in err


@pytest.mark.parametrize("name", ["nowhere.yaml", "x" * 300 + ".yaml"])
def test_a_file_that_cannot_be_read_has_no_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = checked(tmp_path / name, capsys)
    assert (code, out) == (EXIT_CONFIGURATION, "")
    assert err.startswith(f"{tmp_path / name}: ")
    assert ":1:1" not in err


def test_a_file_of_no_kind_is_told_which_kinds_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "what.yaml"
    path.write_text("experimnt: x\n")
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert "robot, experiment, scenario, study (did you mean 'experiment'?)" in err


def test_damaged_files_are_explained_or_can_be_built() -> None:
    """`python -m tests.experiments.check_mutations` tries ten thousand."""
    assert sum(try_many(FEW, seed=7).values()) == FEW


@pytest.mark.parametrize("robot", ["x" * 300, "builtin:" + "x" * 300, '"\\0"'])
def test_a_name_that_no_file_can_have_is_explained(
    robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "long.yaml"
    path.write_text(
        f"experiment: long\nrobot: {robot}\ncontroller: {{kind: broyden}}\n"
        "trajectory: {kind: hold, position_mm: [0.0, 0.0, 190.0], duration_s: 1.0}\n"
    )
    code, _, err = checked(path, capsys)
    assert code == EXIT_CONFIGURATION
    assert "robot: there is no file" in err
