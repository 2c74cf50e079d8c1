"""Whom the gate asks in an experiment, and what hangs at the tip meanwhile."""

from pathlib import Path

import pytest

from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.risk import risk_source_of
from daemon.workbench.experiments.trial import TrialError
from safety.risk_source import NoModel
from tests import SOFT_ARM
from tests.daemon.service.grazing import StoppedClock

CHEST = SOFT_ARM.parents[1] / "experiments" / "chest_circle.yaml"


def written(folder: Path, more: str) -> Path:
    path = folder / "experiment.yaml"
    path.write_text(CHEST.read_text() + more)
    return path


def test_an_experiment_may_go_without_the_risk(tmp_path: Path) -> None:
    file = load_experiment(written(tmp_path, "risk: false\n"))
    assert isinstance(risk_source_of(file, StoppedClock()), NoModel)


@pytest.mark.parametrize(
    "more",
    ["tip_load_g: 20.0\n", "happenings: [{at_cycle: 1, tip_load_g: 20.0, fill_g_s: 1.0}]\n"],
)
def test_a_load_that_the_model_was_not_made_with_is_refused(tmp_path: Path, more: str) -> None:
    file = load_experiment(written(tmp_path, more))
    with pytest.raises(TrialError, match="not with 20 g: train one with that load"):
        risk_source_of(file, StoppedClock())
