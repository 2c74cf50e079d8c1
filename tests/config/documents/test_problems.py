"""Errors that tell of many problems at once."""

import pickle
from pathlib import Path

import pytest

from config.documents.model import OptionsError
from config.documents.problems import ConfigError, Problem
from daemon.reference.waypoints import WaypointError
from daemon.workbench.body_model.clouds.cloud_table import CloudImportError

_TOLD = ("the first", "the second")


@pytest.mark.parametrize(
    "error",
    [
        ConfigError(Problem("robot.yaml", 1 + line, 1, "", _TOLD[line]) for line in range(2)),
        OptionsError(_TOLD),
        WaypointError(_TOLD),
        CloudImportError(Path("clouds"), _TOLD),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_of_a_process_that_works_for_another_says_the_same_there(error: Exception) -> None:
    told = pickle.loads(pickle.dumps(error))
    assert type(told) is type(error)
    assert str(told) == str(error)
    assert all(what in str(told) for what in _TOLD)
