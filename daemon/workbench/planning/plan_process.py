"""The planner for a running daemon: `python -m daemon.workbench.planning.plan_process`.

One `PlanRequest` in, one `PlanOutcome` out, both as JSON.
"""

from pathlib import Path

import msgspec
import numpy as np

from config.control import Surface
from config.documents.problems import ConfigError
from config.loader import load_robot
from daemon.host.processes import serve_apart
from daemon.risk.body_risk_source import RiskFilesError, read_risk_files
from daemon.service.operation.planning import PlanOutcome, PlanRequest
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import BodyInPlace
from daemon.workbench.planning.goals import TipGoal
from daemon.workbench.planning.plan import Settings, figures_of, path_of
from daemon.workbench.planning.planner import Planner


def answer(content: bytes) -> bytes:
    """What there is of a request."""
    request = msgspec.json.decode(content, type=PlanRequest)
    try:
        outcome = _planned(request)
    except (ConfigError, RiskFilesError) as error:
        outcome = PlanOutcome(none="not_planned", text=str(error))
    return msgspec.json.encode(outcome)


def _planned(request: PlanRequest) -> PlanOutcome:
    file = load_robot(Path(request.robot_path))
    surface = Surface.model_validate_json(msgspec.json.encode(request.surface))
    files = read_risk_files(file, surface=surface)
    settings = Settings(
        most_risk=request.most_risk, tip_mm_s=request.tip_speed_mm_s, seed=request.seed
    )
    body = BodyInPlace(file.robot, files.model.model, files.environment, files.grid)
    direction = None
    if request.pointing is not None:
        direction = np.array(request.pointing) / np.linalg.norm(request.pointing)
    goals = [TipGoal(np.array(place)) for place in request.via_mm]
    goals.append(TipGoal(np.array(request.to_mm), direction))
    found = Planner(body, settings).plan(np.array(request.u), goals)
    if isinstance(found, Blocked):
        return PlanOutcome(none=found.why, text=found.text)
    figures = figures_of(found, settings, "optimised")
    path = path_of(found, figures, file.robot, files.identity, direction is not None)
    return PlanOutcome(path=path.model_dump(mode="json"))


def main() -> None:
    # numba, which whoever only asks for an answer does not wait for.
    from daemon.host.compilation import forgive_caches

    forgive_caches()
    serve_apart(answer)


if __name__ == "__main__":
    main()
