"""`tentacled init`: what it makes works as it stands."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from config.loader import load_robot
from daemon.commands.host.init import _EXPERIMENTS
from daemon.commands.outcome.exit_codes import EXIT_CANNOT_CREATE, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from tests.installed_package import installed

ROOT = Path(__file__).parents[3]


def installed_as_it_stands(project: Path, site: Path) -> Path:
    """The made project, as pip would have installed it, without pip."""
    about = tomllib.loads((project / "pyproject.toml").read_text())
    name, version = about["project"]["name"], about["project"]["version"]
    (site / name).parent.mkdir(parents=True, exist_ok=True)
    (site / name).symlink_to(project / name)
    metadata = site / f"{name}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, points in about["project"]["entry-points"].items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in points.items()))
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return site


@pytest.mark.long
def test_the_made_controller_passes_its_own_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = tmp_path / "my_controller"
    assert main(["init", "controller", str(project)]) == 0
    assert f"pytest {project}" in capsys.readouterr().out
    source = (project / "my_controller" / "controller.py").read_text().splitlines()
    assert len(source) <= 60
    site = installed_as_it_stands(project, tmp_path / "site")
    with installed(site):
        assert main(["plugins"]) == 0
    assert "my_controller 0.1.0" in " ".join(capsys.readouterr().out.split())
    path = os.pathsep.join([str(site), str(ROOT)])
    plugin = ["-p", "no:tentacled", "-p", "daemon.testing.pytest_plugin", "-p", "no:cacheprovider"]
    words = [sys.executable, "-m", "pytest", "-q", "-W", "error", *plugin, str(project)]
    done = subprocess.run(
        words,
        cwd=project,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


@pytest.mark.parametrize("like", _EXPERIMENTS)
def test_the_made_robot_and_its_experiment_are_sound(
    like: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "my-arm"
    assert main(["init", "robot", str(folder), "--like", like]) == 0
    made = capsys.readouterr().out
    assert main(["check", str(folder / "robot.yaml")]) == 0
    assert main(["check", str(folder / "experiment.yaml")]) == 0
    assert "sound" in capsys.readouterr().out
    robot = load_robot(folder / "robot.yaml").robot
    assert {axis.drive.eds for axis in robot.axes} == {"stepper.eds"}
    assert robot.robot == ("my_arm" if like == "soft_arm" else like)
    assert (f"it is still called {like}" in made) is (robot.robot == like)


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["controller", "broyden"], EXIT_USAGE, "there is a controller broyden already"),
        (["controller", "Mine!"], EXIT_USAGE, "must be a lower-case word"),
        (["robot", "there"], EXIT_CANNOT_CREATE, "there: File exists"),
    ],
)
def test_what_cannot_be_made_is_explained(
    words: list[str],
    code: int,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    assert main(["init", *words]) == code
    assert told in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


@pytest.mark.parametrize("name", ["numpy", "json", "class"])
def test_a_controller_is_not_named_as_what_python_has(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", "controller", str(tmp_path / name)]) == EXIT_USAGE
    assert f"Python has a word or a module {name} already" in capsys.readouterr().err
    assert not (tmp_path / name).exists()
