"""Whom the gate asks in an experiment."""

from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.trial import TrialError
from drivers.clock import WallClock
from safety.risk_source import NoModel, RiskSource


def risk_source_of(file: ExperimentFile, clock: WallClock) -> RiskSource:
    """What the robot file names, or nobody if the experiment wants it so. Raises TrialError."""
    if not file.experiment.risk or file.robot.risk.model is None:
        return NoModel()
    # Most robots name no model, and what reads one is slow to come.
    from daemon.risk.body_risk_source import RiskFilesError, make_risk_source

    try:
        return make_risk_source(file.file, clock, tip_loads_g(file))
    except RiskFilesError as error:
        raise TrialError(str(error)) from None


def tip_loads_g(file: ExperimentFile) -> list[float]:
    """What hangs at the tip, at first and later."""
    loads_g = [happening.tip_load_g for happening in file.experiment.happenings]
    return [file.experiment.tip_load_g, *(load_g for load_g in loads_g if load_g is not None)]
