"""Plays a scenario in a lab: each event at its time, all of them understood before the first."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from config.documents.problems import ConfigError
from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import read_yaml
from config.tasks.scenario import Scenario, ScenarioEvent
from sim_backends.faults import FaultError, understand
from sim_backends.lab.lab import Lab


def load_scenario(path: Path, lab: Lab) -> Scenario:
    """Read a scenario for `lab`. Raises ConfigError with every problem of the file."""
    document = read_yaml(path)
    problems = list(document.problems)
    if not problems:
        try:
            scenario = Scenario.model_validate(document.value)
        except ValidationError as error:
            problems += schema_problems(document, Scenario, error)
        else:
            for index, event in enumerate(scenario.events):
                if event.inject is not None:
                    try:
                        understand(lab.devices, event.inject)
                    except FaultError as error:
                        problems.append(document.problem(("events", index, "inject"), str(error)))
            if not problems:
                return scenario
    raise ConfigError(problems)


def play_scenario(scenario: Scenario, lab: Lab, tell: Callable[[str], None]) -> None:
    """Begin a scenario now. tell: hears of every event when it happens."""
    loop = asyncio.get_running_loop()
    for event in scenario.events:
        loop.call_later(event.at_s, _happen, event, lab, tell)


def _happen(event: ScenarioEvent, lab: Lab, tell: Callable[[str], None]) -> None:
    if event.tip_load_g is not None:
        lab.set_tip_load(event.tip_load_g)
        tell(f"{event.at_s:g} s: {event.tip_load_g:g} g at the tip")
        return
    assert event.inject is not None
    try:
        lab.inject(event.inject)
    except FaultError as error:
        tell(f"{event.at_s:g} s: {error}")
    else:
        tell(f"{event.at_s:g} s: {event.inject}")
