"""The same search with the same effort for every controller: what it makes and what it keeps."""

from pathlib import Path

import msgspec
import pytest

from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_USAGE
from daemon.commands.terminal import study_command
from daemon.commands.terminal.command_line import main
from daemon.workbench.bench.tuning import (
    Stage,
    candidates,
    scores,
    stages,
    survivors,
    tuned_text,
)
from daemon.workbench.studies.run import Outcome, PlanError
from daemon.workbench.studies.study_file import StudyFile, load_study, load_tuned
from tests.daemon.workbench.studies import made_up

STUDY = """
study: small
matrix:
  - robot: arm
    experiment: calm.yaml
    paths:
      - path: circle
        trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 5}
        speeds_mm_s: [10, 15]
variants:
  - variant: arcs
    label: arcs
    controller: {kind: constant_curvature}
    tune: {gain_per_s: {low: 1.0, high: 9.0, log: true}, damping_mm: {low: 2, high: 10}}
  - {variant: fixed, label: fixed}
seeds: 1
plants: 0
"""


@pytest.fixture
def file(tmp_path: Path) -> StudyFile:
    return load_study(made_up.write_study(tmp_path, STUDY))


def test_points_lie_within_their_ranges_and_a_seed_says_which(file: StudyFile) -> None:
    made = candidates(file.study, 6, 1)
    assert [one.of for one in made] == ["arcs"] * 6
    assert [one.variant.variant for one in made] == [f"arcs_{k}" for k in range(6)]
    gains = [one.options["gain_per_s"] for one in made]
    assert all(1.0 <= gain <= 9.0 for gain in gains)
    assert sum(gain < 3.0 for gain in gains) == 3
    assert all(2.0 <= one.options["damping_mm"] <= 10.0 for one in made)
    assert made[0].variant.controller == {"kind": "constant_curvature", **made[0].options}
    assert [one.options for one in candidates(file.study, 6, 1)] == [one.options for one in made]
    assert [one.options for one in candidates(file.study, 6, 2)] != [one.options for one in made]


def test_nothing_to_tune_is_told(file: StudyFile) -> None:
    study = file.study.model_copy(update={"variants": file.study.variants[1:]})
    with pytest.raises(PlanError, match="no variant"):
        candidates(study, 4, 1)


@pytest.mark.parametrize("name", ["fixed", "arc"])
def test_who_has_nothing_to_tune_is_named_beside_those_that_have(
    file: StudyFile, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["tune", str(file.path), "--out", str(tmp_path / "out"), "--controllers", name]
    assert main(words) == EXIT_USAGE
    assert f"no options of {name} are to be sought in this study: those of arcs are" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "out").exists()


def test_half_of_the_points_see_twice_the_cells() -> None:
    assert stages(8, 4) == [Stage(8, 1), Stage(4, 2), Stage(2, 4)]
    assert stages(5, 1) == [Stage(5, 1), Stage(3, 1), Stage(2, 1)]
    assert stages(1, 4) == [Stage(1, 4)]


def test_a_run_that_was_given_up_counts_as_unstable_and_one_that_all_refuse_does_not(
    file: StudyFile,
) -> None:
    """Who alone refuses the hard one of two paths is no better for it."""

    def run(experiment: str, variant: str, failure: str = "", refused: bool = False) -> Outcome:
        one = made_up.outcome([1.0], 1, experiment, variant, failure)
        return msgspec.structs.replace(one, refused=refused)

    everybody = [run("fast", f"arcs_{number}", "too fast", refused=True) for number in (0, 1)]
    lost = run("calm", "arcs_0", "node lost")
    assert scores([*everybody, lost], file.study) == {"arcs_0": pytest.approx(2.9957, abs=1e-4)}
    alone = run("calm", "arcs_1", "too fast", refused=True)
    scored = scores([*everybody, lost, alone], file.study)
    assert scored["arcs_1"] == scored["arcs_0"] == pytest.approx(2.9957, abs=1e-4)


def test_the_best_of_each_variant_are_kept(file: StudyFile, tmp_path: Path) -> None:
    made = candidates(file.study, 4, 1)
    scored = {"arcs_0": 0.5, "arcs_1": -1.0, "arcs_2": 0.1, "arcs_3": 2.0}
    kept = survivors(made, scored, 2)
    assert [one.variant.variant for one in kept] == ["arcs_1", "arcs_2"]
    path = tmp_path / "tuned.yaml"
    path.write_text(tuned_text(file.study, kept[:1], scored, "All alike."))
    tuned = load_tuned(path)
    assert tuned.variants == {"arcs": dict(kept[0].options)}
    assert tuned.search == "All alike."


def test_a_search_goes_through_its_stages_and_leaves_a_file_that_a_study_can_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    study = made_up.write_study(tmp_path, STUDY.replace("[10, 15]", "[15]"))
    words = ["tune", str(study), "--out", str(out), "--points", "2", "--jobs", "1"]
    assert main(words) == 0
    tuned = load_tuned(out / "tuned.yaml")
    assert set(tuned.variants) == {"arcs"}
    assert "2 Sobol points with seed 1" in tuned.search
    assert len(list(out.glob("runs/*/*/*/outcome.json"))) == 2
    capsys.readouterr()
    assert main(words) == 0
    assert "2 runs are done already" in capsys.readouterr().out


def test_without_a_run_nothing_is_found_and_that_is_told(
    file: StudyFile,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(study_command, "carry_out_runs", lambda _runs, _arguments: 1)
    out = tmp_path / "out"
    assert main(["tune", str(file.path), "--out", str(out), "--points", "2"]) == EXIT_FAILED
    assert "nothing was found: no run was carried out" in capsys.readouterr().err
    assert not (out / "tuned.yaml").exists()
