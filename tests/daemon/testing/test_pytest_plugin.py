"""The fixtures in a suite of somebody else's: run by pytest in a process of its own."""

import json
import os
import tempfile
import xml.etree.ElementTree as ET
from importlib import import_module
from pathlib import Path

import pytest

from daemon.testing.labs import TestLab

pytest_plugins = ["pytester"]

# What is imported while a suite is run here is forgotten afterwards, and would come a second time.
import_module("daemon.testing.rig")

EXPERIMENT = """
experiment: short
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 6, cycle_s: 2.5}
controller: {kind: constant_curvature}
risk: false
"""

TESTS = """
import pytest

def test_circle(lab):
    result = lab.run("short.yaml")
    assert result.holds == 0 and not result.faults
    assert result.cycle(1).mean_mm < 3.0
    assert result.state_at(1.0) == "running"
    assert result.final_state in ("standby", "ready")

def test_too_good(lab):
    figures = lab.run("short.yaml", seed=5).cycle(1)
    assert figures.mean_mm < 0.001

@pytest.mark.tentacled_seeds(2, plants=2)
def test_many(seed, plant):
    assert seed in (1, 2) and plant in (0, 1)

@pytest.mark.tentacled_rig
def test_real(rig):
    raise AssertionError("it moved")
"""


THEIRS = """
import pytest

@pytest.fixture
def seed():
    return 77

@pytest.fixture
def followed(lab):
    return lab.run("short.yaml", longest_s=2.0)

def test_their_seed_with_our_lab(lab, seed):
    assert seed == 77

def test_followed(followed):
    pass
"""

LOST = """
import pytest

LOST = [{"at_s": 1.0, "inject": "bus.can0.off"}]

def test_fails(lab):
    lab.run("short.yaml", happenings=LOST)

def test_expects_it(lab):
    result = lab.run("short.yaml", happenings=LOST, may_end_early=True)
    assert "bus_off" in " ".join(result.faults) + result.problem
    assert result.state_at(0.5) == "running"
    with pytest.raises(LookupError, match="nothing is recorded"):
        result.state_at(-1.0)

def test_other_numbers(lab):
    trajectory = {"radius_mm": 5.0, "cycle_s": 2.0}
    result = lab.run("short.yaml", trajectory=trajectory)
    assert result.result.duration_s < 2.5
"""


@pytest.fixture
def suite(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    """A suite with an experiment beside it."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    pytester.makefile(".yaml", short=EXPERIMENT)
    pytester.makepyfile(TESTS)
    return pytester


# Whether it is installed with an entry point or not.
PLUGIN = ("-p", "no:tentacled", "-p", "daemon.testing.pytest_plugin")
STRICT = ("-W", "error", "--strict-markers", "-p", "no:cacheprovider")


def run(suite: pytest.Pytester, *words: str) -> pytest.RunResult:
    return suite.runpytest_subprocess(*PLUGIN, *STRICT, *words)


def run_here(suite: pytest.Pytester, *words: str) -> pytest.RunResult:
    """Without a process of its own: of tests that use no lab."""
    return suite.runpytest_inprocess(*PLUGIN, *STRICT, *words)


@pytest.mark.parametrize(
    "workers",
    [
        pytest.param((), id="alone"),
        pytest.param(("-n", "2"), id="two workers", marks=pytest.mark.long),
    ],
)
def test_a_failing_test_is_explained_in_millimetres_and_kept(
    suite: pytest.Pytester, workers: tuple[str, ...]
) -> None:
    """Beside others of their own, in one session: starting it takes longer than its runs."""
    suite.makepyfile(test_theirs=THEIRS, test_lost=LOST)
    artifacts, junit = suite.path / "kept", suite.path / "junit.xml"
    result = run(suite, *workers, "--tentacled-artifacts", str(artifacts), f"--junitxml={junit}")
    result.assert_outcomes(passed=5 + 1 + 2, failed=1 + 1, errors=1, skipped=1)
    told = result.stdout.str()
    assert "where" in told and "= cycle 1 of run-0: mean " in told
    assert "run-0: circle, constant_curvature" in told
    assert f"kept in {artifacts}" in told
    kept, lost, followed = sorted(artifacts.iterdir(), key=lambda path: path.name)
    assert "test_too_good" in kept.name
    left = {path.name for path in (kept / "run-0").iterdir()}
    assert {"result.json", "report.html", "steps.npz"} <= left
    assert any(name.endswith(".mcap") for name in left)
    # A fixture of theirs may run experiments and give seeds.
    assert "test_followed" in followed.name
    assert (followed / "run-0" / "result.json").is_file()
    # A run that does not come to its end fails with the reason.
    assert "test_fails" in lost.name
    assert "did not come to its end: the robot is fault" in told
    cases = ET.parse(junit).getroot().iter("testcase")
    properties = {
        case.attrib["name"]: {
            one.attrib["name"]: one.attrib["value"] for one in case.iter("property")
        }
        for case in cases
    }
    figure = float(properties["test_too_good"]["tentacled.run-0.cycle_1.mean_mm"])
    recorded = json.loads((kept / "run-0" / "result.json").read_text())["cycles"][0]["mean_mm"]
    assert figure == pytest.approx(recorded, abs=1e-4)
    assert properties["test_too_good"]["tentacled.run-0.seed"] == "5"
    assert properties["test_circle"]["tentacled.run-0.holds"] == "0"


def test_seeds_and_bodies_come_from_the_marker_and_the_options(suite: pytest.Pytester) -> None:
    names = run_here(suite, "--collect-only", "-q", "-k", "many").stdout.str()
    for seed in (1, 2):
        for plant in (0, 1):
            assert f"test_many[{plant}-{seed}]" in names or f"test_many[{seed}-{plant}]" in names
    options = ("--tentacled-seeds", "3", "--tentacled-plants", "1")
    names = run_here(suite, "--collect-only", "-q", "-k", "many", *options).stdout.str()
    assert names.count("test_many[") == 3


def test_names_that_are_somebody_elses_stay_theirs(suite: pytest.Pytester) -> None:
    """`seed` and `plant` are common names: only a marker or a lab makes them ours."""
    suite.makepyfile(
        test_theirs="""
        import pytest

        @pytest.fixture
        def seed():
            return "of a flower"

        def test_a_fixture(seed):
            assert seed == "of a flower"

        @pytest.mark.parametrize(["plant", "pot"], [("rose", 1), ("lily", 2)])
        def test_a_list_of_names(lab, plant, pot):
            assert plant in ("rose", "lily")

        @pytest.mark.parametrize(("seed"), [7])
        @pytest.mark.tentacled_seeds(3)
        def test_its_own_values(seed):
            assert seed == 7
        """
    )
    suite.makepyfile(
        test_ours="def test_without_a_marker(seed, plant):\n    assert (seed, plant) == (1, 0)"
    )
    run(suite, "test_theirs.py", "test_ours.py").assert_outcomes(passed=5)
    asked = ("--collect-only", "-q", "--tentacled-seeds", "4")
    assert run_here(suite, "test_theirs.py", *asked).stdout.str().count("::test_") == 4


def test_the_marker_counts_by_place_or_name_and_what_it_cannot_count_is_told(
    suite: pytest.Pytester,
) -> None:
    test = "import pytest\n@pytest.mark.tentacled_seeds({})\ndef test_it(seed, plant): pass"
    for said, tests in (("seeds=3", 3), ("2, 2", 4), ("plants=2", 2)):
        suite.makepyfile(test_said=test.format(said))
        run_here(suite, "test_said.py").assert_outcomes(passed=tests)
    for said, told in (("0", "'0' is no number from 1 on"), ("seed=3", "keyword argument 'seed'")):
        suite.makepyfile(test_said=test.format(said))
        result = run_here(suite, "test_said.py").stdout.str()
        assert "test_said.py::test_it: tentacled_seeds(seeds, plants=1): " in result
        assert told in result and "Traceback" not in result
    refused = run_here(suite, "--tentacled-seeds", "0").stderr.str()
    assert "'0' is no number from 1 on" in refused


@pytest.mark.long
def test_runs_that_cannot_be_kept_end_no_session(suite: pytest.Pytester) -> None:
    no_folder = suite.path / "a file"
    no_folder.touch()
    words = ("-k", "too_good or many", "--tentacled-artifacts", str(no_folder))
    result = run(suite, *words)
    result.assert_outcomes(passed=4, failed=1)
    assert f"not kept in {no_folder}" in result.stdout.str()


def test_a_real_robot_is_never_moved_by_accident(suite: pytest.Pytester) -> None:
    robot = Path(__file__).parents[3] / "config" / "robots" / "soft_arm.yaml"
    for words, why in (
        ((), "--tentacled-rig ROBOT.yaml is not given"),
        (("--tentacled-rig", str(robot)), "--tentacled-rig-yes soft_arm is not given"),
        (
            ("--tentacled-rig", str(robot), "--tentacled-rig-yes", "tendon_arm"),
            "--tentacled-rig-yes soft_arm is not given",
        ),
        (
            ("--tentacled-rig", str(robot), "--tentacled-rig-yes", "soft_arm"),
            "start it with `tentacled run",
        ),
    ):
        result = run_here(suite, "-k", "test_real", "-rs", *words)
        result.assert_outcomes(skipped=1, deselected=6)
        assert why in " ".join(result.stdout.str().split())
    suite.makepyfile(test_unmarked="def test_unmarked(rig): pass")
    result = run_here(suite, "-k", "test_unmarked.py")
    result.assert_outcomes(errors=1, deselected=7)


def test_nothing_of_ours_is_imported_before_a_fixture_is_used(suite: pytest.Pytester) -> None:
    suite.makepyfile(
        test_none="""
        import sys
        def test_none():
            ours = ("daemon.", "config.", "sim_backends.", "safety.", "drivers.", "numpy")
            came = {name for name in sys.modules if name.startswith(ours)}
            assert came == {"daemon.testing", "daemon.testing.pytest_plugin"}
        """
    )
    run(suite, "test_none.py").assert_outcomes(passed=1)


@pytest.mark.long
@pytest.mark.hil
@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["alone", "two workers"])
def test_a_live_lab_has_processes_of_its_own_and_real_time(
    suite: pytest.Pytester, workers: tuple[str, ...]
) -> None:
    """Each of two tests has its own; the one that fails is explained, and its run is kept."""
    suite.makepyfile(
        test_live="""
        import time

        import pytest

        PATIENT = {"longest_s": 60.0}

        def test_in_real_time(live_lab):
            began_s = time.monotonic()
            result = live_lab.run("short.yaml", **PATIENT)
            assert time.monotonic() - began_s > 4.0
            assert result.final_state in ("standby", "ready")
            assert result.cycle(1).mean_mm < 5.0
            with pytest.raises(LookupError):
                result.true_cycle(1)

        def test_too_good_again(live_lab):
            assert live_lab.run("short.yaml", **PATIENT).cycle(1).mean_mm < 0.001
        """
    )
    artifacts, junit = suite.path / "kept", suite.path / "junit.xml"
    words = ("--tentacled-artifacts", str(artifacts), f"--junitxml={junit}", "test_live.py")
    result = run(suite, *workers, *words)
    result.assert_outcomes(passed=1, failed=1)
    told = result.stdout.str()
    assert "= cycle 1 of run-0: mean " in told
    assert f"kept in {artifacts}" in told
    (kept,) = artifacts.iterdir()
    assert "test_too_good_again" in kept.name
    left = {path.name for path in (kept / "run-0").iterdir()}
    assert {"result.json", "report.html"} <= left
    names = {one.attrib["name"] for one in ET.parse(junit).getroot().iter("property")}
    assert "tentacled.run-0.cycle_1.mean_mm" in names


def test_several_users_of_one_machine_do_not_stand_in_each_other_s_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is left in the folder for temporary files, which all of them share, is one's own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    TestLab(tmp_path, tmp_path / "runs", real_time=False)
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(f"-{os.getuid()}")
    assert left.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("numbers", [{"seed": -1}, {"plant": -2}])
def test_a_seed_or_body_below_0_is_refused_before_anything_runs(
    numbers: dict[str, int], tmp_path: Path
) -> None:
    lab = TestLab(tmp_path, tmp_path / "runs", real_time=False)
    with pytest.raises(ValueError, match="neither is below 0"):
        lab.run("builtin:rectangle", seed=numbers.get("seed"), plant=numbers.get("plant", 0))
    assert not lab.runs
