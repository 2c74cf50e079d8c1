"""A study is carried out in several processes, and again only what is not done yet."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.host.processes import Share
from daemon.workbench.pretraining.model_cache import needs_model
from daemon.workbench.studies import worker
from daemon.workbench.studies.grid import Grid, _one_for_each_model
from daemon.workbench.studies.run import Outcome, Run, plan, read_outcome, shared
from daemon.workbench.studies.study_file import load_study
from tests.daemon.workbench.studies.made_up import write_study

pytestmark = pytest.mark.xdist_group("study_grid")  # whose runs are done once for all tests

CYCLE_S = 3.0
STUDY = """
study: small
tables:
  - title: Table 1
    rows: [{experiment: calm.yaml, label: no load}]
figures:
  - {figure: path, title: Path, experiments: [calm]}
variants:
  - {variant: arcs, label: arcs, controller: {kind: constant_curvature}}
  - {variant: stubborn, label: stubborn, controller: {kind: broyden, posture: [1.0, 2.0]}}
seeds: 1
plants: 1
"""


class Heard:
    def __init__(self) -> None:
        self.begun: list[tuple[int, int, int]] = []
        self.runs: list[tuple[str, Outcome | None, str]] = []

    def begin(self, done: int, models: int, runs: int) -> None:
        self.begun.append((done, models, runs))

    def model(self, run: Run, error: str) -> None:
        raise AssertionError("nothing here needs a model")

    def run(self, run: Run, outcome: Outcome | None, error: str) -> None:
        self.runs.append((run.variant, outcome, error))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path, Heard]]:
    folder = tmp_path_factory.mktemp("grid")
    path = write_study(folder / "study", STUDY, CYCLE_S)
    heard = Heard()
    Grid(plan(load_study(path), 1, 1), folder / "out").carry_out(2, False, heard)
    yield path, folder / "out", heard


def test_every_run_is_done_and_heard_of(done: tuple[Path, Path, Heard]) -> None:
    _, _, heard = done
    assert heard.begun == [(0, 0, 2)]
    told = {variant: outcome for variant, outcome, error in heard.runs if not error}
    assert set(told) == {"arcs", "stubborn"}
    good, bad = told["arcs"], told["stubborn"]
    assert good is not None
    assert good.result is not None
    assert [cycle.cycle for cycle in good.result.cycles] == [0, 1]
    assert good.result.true_cycles
    assert good.result.computing is not None
    assert bad is not None
    assert bad.failure == "posture has 2 positions, and the robot 6 axes"


BENCH = """
study: small
matrix:
  - robot: arm
    experiment: calm.yaml
    paths:
      - path: circle
        trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 5}
        speeds_mm_s: [5, 10]
variants:
  - {variant: broyden, label: broyden}
  - {variant: arcs, label: arcs, controller: {kind: constant_curvature}}
seeds: 2
plants: 0
"""


def test_the_model_that_tells_whether_paths_can_be_followed_is_made_before_the_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once for each seed, though no controller begins with it."""
    path = write_study(tmp_path, BENCH)
    with (tmp_path / "calm.yaml").open("a") as file:
        file.write("pretraining: {}\n")
    makers = _one_for_each_model(plan(load_study(path), 2, 0))
    assert [run.seed for run in makers] == [1, 2]
    made = []
    monkeypatch.setattr(worker, "with_model", lambda file, *_: made.append(needs_model(file)))
    worker.make_model(makers[0])
    assert made == [True]


@pytest.mark.parametrize(("robot", "models"), [("tendon_arm", 2), ("soft_arm", 1)])
def test_who_is_asked_for_the_risk_has_a_model_of_its_own_where_there_is_one_of_the_body(
    tmp_path: Path, robot: str, models: int
) -> None:
    """The tendon arm is explored otherwise among its obstacles; the soft arm's file has none."""
    both = "{experiment: calm.yaml, label: one}, {experiment: loaded.yaml, label: other}"
    text = STUDY.replace("{experiment: calm.yaml, label: no load}", both)
    path = write_study(tmp_path, text.replace("constant_curvature", "forward_jacobian"))
    for name, asked in (("calm", "true"), ("loaded", "false")):
        text = (tmp_path / f"{name}.yaml").read_text().replace("soft_arm", robot)
        (tmp_path / f"{name}.yaml").write_text(f"{text}risk: {asked}\npretraining: {{}}\n")
    assert len(_one_for_each_model(plan(load_study(path), 1, 0))) == models


def test_a_fault_that_no_device_has_is_told_before_any_run_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_study(tmp_path)
    with (tmp_path / "loaded.yaml").open("a") as file:
        file.write("happenings: [{at_s: 1, inject: tracker.mising=1s}]\n")
    words = ["compare", "--study", str(path), "--out", str(tmp_path / "out")]
    assert main(words) == EXIT_CONFIGURATION
    err = capsys.readouterr().err
    assert "loaded.yaml:8:32: happenings[0].inject: " in err
    assert "tracker has no fault 'mising'" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_shares_put_together_are_the_same_runs_and_tables(
    done: tuple[Path, Path, Heard], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out, _ = done
    words = ["compare", "--study", str(path), "--jobs", "1", "--seeds", "1", "--plants", "1"]
    both, merged = [tmp_path / "1", tmp_path / "2"], tmp_path / "merged"
    for index, folder in enumerate(both, 1):
        share = ["--share", f"{index}/2"]
        code = main([*words, "--out", str(folder), *share])
        assert code == 0
        assert f"share {index}/2: 1 runs; 1 of 2 are in the folder" in capsys.readouterr().out
        assert not list(folder.glob("*.html"))
        shutil.copytree(folder, merged, dirs_exist_ok=True)
    assert main([*words, "--out", str(merged)]) == 0
    again = capsys.readouterr()
    assert "2 runs are done already" in again.out

    def figures(folder: Path) -> list[object]:
        runs = plan(load_study(path), 1, 1)
        outcomes = Grid(runs, folder).outcomes()
        return [
            (one.experiment, one.variant, one.failure, one.result and one.result.true_cycles)
            for one in outcomes
        ]

    assert figures(merged) == figures(out)
    assert len(figures(merged)) == 2


@pytest.mark.parametrize("words", ["0/2", "3/2", "half", "1/", "-1/2", "1/0"])
def test_a_share_that_is_none_is_explained(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="64"):
        main(["compare", "--out", "x", f"--share={words}"])
    assert "share" in capsys.readouterr().err


def test_every_run_is_in_one_share(done: tuple[Path, Path, Heard]) -> None:
    runs = plan(load_study(done[0]), 5, 3)
    parts = [shared(runs, Share(index, 4)) for index in (1, 2, 3, 4)]
    assert sorted(str(run) for part in parts for run in part) == sorted(map(str, runs))
    assert {len(part) for part in parts} <= {7, 8}


def test_a_run_leaves_what_pictures_need_and_no_recording(
    done: tuple[Path, Path, Heard],
) -> None:
    _, out, _ = done
    (folder,) = out.glob("runs/calm/arcs/*")
    names = {path.name for path in folder.iterdir()}
    assert folder.name == "plant-1-seed-1"
    files = {"outcome.json", "result.json", "steps.npz", "robot.yaml", "provenance.json"}
    assert names == files


def test_what_is_done_is_not_done_again(done: tuple[Path, Path, Heard]) -> None:
    path, out, _ = done
    heard = Heard()
    Grid(plan(load_study(path), 1, 1), out).carry_out(2, False, heard)
    assert heard.begun == [(2, 0, 0)]
    assert heard.runs == []


def test_under_other_conditions_it_is_not_done(
    done: tuple[Path, Path, Heard], tmp_path: Path
) -> None:
    path, out, _ = done
    (run,) = plan(load_study(path), 1, 1, ["arcs"])
    assert read_outcome(run, out) is not None
    changed = STUDY.replace("constant_curvature}", "constant_curvature, gain_per_s: 2.0}")
    other = load_study(write_study(tmp_path / "changed", changed, CYCLE_S))
    (run,) = plan(other, 1, 1, ["arcs"])
    assert read_outcome(run, out) is None


def test_a_damaged_outcome_counts_as_none(done: tuple[Path, Path, Heard], tmp_path: Path) -> None:
    path, _, _ = done
    (run,) = plan(load_study(path), 1, 1, ["arcs"])
    run.folder(tmp_path).mkdir(parents=True)
    (run.folder(tmp_path) / "outcome.json").write_text('{"experiment": "calm"')
    assert read_outcome(run, tmp_path) is None


@pytest.mark.parametrize(
    ("command", "picture"), [("reproduce", "path-arcs.png"), ("compare", "comparison.png")]
)
def test_the_commands_write_up_what_is_there(
    done: tuple[Path, Path, Heard],
    capsys: pytest.CaptureFixture[str],
    command: str,
    picture: str,
) -> None:
    path, out, _ = done
    study = [str(path)] if command == "reproduce" else ["--study", str(path)]
    assert main([command, *study, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "2 runs are done already" in printed
    assert "1 failed" in printed
    assert (out / picture).stat().st_size > 10_000
    data = json.loads((out / "tables.json").read_text())
    assert [one["variant"] for one in data["summaries"]] == ["arcs", "stubborn"]


def test_a_name_that_is_not_in_the_study_is_refused(
    done: tuple[Path, Path, Heard], capsys: pytest.CaptureFixture[str]
) -> None:
    path, out, _ = done
    assert main(["reproduce", str(path), "--out", str(out), "--only", "wild"]) == EXIT_USAGE
    told = "no wild among the study's experiments and controllers: there are calm, arcs"
    assert told in capsys.readouterr().err


def test_a_study_that_is_not_there_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["reproduce", str(tmp_path / "no.yaml"), "--out", str(tmp_path)]) == EXIT_CONFIGURATION
    )
    assert "no.yaml" in capsys.readouterr().err
