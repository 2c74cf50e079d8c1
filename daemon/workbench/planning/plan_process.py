"""The planner for a running daemon: `python -m daemon.workbench.planning.plan_process`.

One `PlanRequest` in, one `PlanOutcome` out, both as JSON.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from config.control import RiskSettings, Surface
from config.documents.problems import ConfigError
from config.loader import load_robot
from daemon.host.processes import serve_apart
from daemon.risk.body_risk_source import RiskFiles, RiskFilesError, read_risk_files
from daemon.risk.surroundings import BodySize
from daemon.service.operation.planning import PlanOutcome, PlanRequest, SeenBody
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import AsSeen, BodyInPlace
from daemon.workbench.planning.goals import TipGoal
from daemon.workbench.planning.plan import Settings, figures_of, path_of
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray, IndexArray
from safety.risk.seen_tip import SeenTip, TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import EnvironmentFaultError
from safety.risk.surroundings.regions import Box, Capsule, Region, covered, with_regions

_THINNEST_MM: Final = 1e-3


def answer(content: bytes) -> bytes:
    """What there is of a request."""
    request = msgspec.json.decode(content, type=PlanRequest)
    try:
        outcome = _planned(request)
    except (ConfigError, RiskFilesError, EnvironmentFaultError) as error:
        outcome = PlanOutcome(none="not_planned", text=str(error))
    return msgspec.json.encode(outcome)


def _planned(request: PlanRequest) -> PlanOutcome:
    file = load_robot(Path(request.robot_path))
    surface = Surface.model_validate_json(msgspec.json.encode(request.surface))
    files = read_risk_files(file, surface=surface)
    settings = Settings(
        most_risk=request.most_risk, tip_mm_s=request.tip_speed_mm_s, seed=request.seed
    )
    grid = grid_among(files, request.moving)
    as_seen = None if request.seen is None else _as_seen(file.robot.risk, files, request.seen)
    body = BodyInPlace(file.robot, files.model.model, files.environment, grid, as_seen=as_seen)
    direction = None
    if request.pointing is not None:
        direction = np.array(request.pointing) / np.linalg.norm(request.pointing)
    goals = [TipGoal(np.array(place)) for place in request.via_mm]
    goals.append(TipGoal(np.array(request.to_mm), direction))
    found = Planner(body, settings).plan(np.array(request.u), goals)
    if isinstance(found, Blocked):
        return PlanOutcome(none=found.why, text=found.text + _counted(request.moving))
    figures = figures_of(found, settings, "optimised")
    figures["moving_obstacles"] = len(request.moving)
    path = path_of(found, figures, file.robot, files.identity, direction is not None)
    return PlanOutcome(path=path.model_dump(mode="json"))


def _as_seen(settings: RiskSettings, files: RiskFiles, seen: SeenBody) -> AsSeen:
    accuracies = settings.tip_accuracy_mm, settings.tip_accuracy_rad
    tip = SeenTip(np.array(seen.mean), seen.beside, np.array(seen.value), agrees=True)
    return AsSeen(TipConditioning(files.model.model.basis, *accuracies), tip)


def _counted(moving: Sequence[Sequence[float]]) -> str:
    """What a refusal is told with, where the surroundings alone may leave a way."""
    if not moving:
        return ""
    many = "obstacle" if len(moving) == 1 else "obstacles"
    return f" (with {len(moving)} moving {many} where they may be at this moment)"


def grid_among(files: RiskFiles, moving: Sequence[Sequence[float]]) -> DistanceGrid:
    """Distances of the surroundings and of (k, 7) capsules, as `PlanRequest.moving` has them.

    Where they will be when the path is gone, nobody knows: it keeps away from where they may be
    while they are believed, and the gate asks at every step.
    """
    regions = [
        Region(Capsule((x, y, z), (x + dx, y + dy, z + dz), radius_mm))
        for x, y, z, dx, dy, dz, radius_mm in moving
    ]
    within = covered(regions, BodySize.of(files.model.model).reach)
    if within is None:
        return files.grid
    return with_regions(reaching(files.grid, within), regions)


def reaching(grid: DistanceGrid, within_mm: FloatArray) -> DistanceGrid:
    """The grid with places added as far as (2, 3) lowest and highest coordinates, and its margin.

    What is told there is how far the box is that holds everything solid, which is no more than the
    distance. Outside of a cavity all is solid, and nothing is added.
    """
    if grid.solid_around:
        return grid
    h, shape = grid.spacing_mm, np.array(grid.values_mm.shape)
    low, high = grid.origin_mm, grid.origin_mm + h * (shape - 1)
    before = _steps((low - within_mm[0] + grid.margin_mm) / h)
    after = _steps((within_mm[1] + grid.margin_mm - high) / h)
    if not (before.any() or after.any()):
        return grid
    size = np.maximum(high - low - 2.0 * grid.margin_mm, _THINNEST_MM)
    solid = Region(Box(_three(0.5 * (low + high)), _three(size)))
    nothing = np.full((shape + before + after).tolist(), np.inf, np.float32)
    wider = with_regions(replace(grid, origin_mm=low - h * before, values_mm=nothing), [solid])
    i, j, k = (slice(first, first + count) for first, count in zip(before, shape, strict=True))
    wider.values_mm[i, j, k] = grid.values_mm
    return wider


def _steps(lacking: FloatArray) -> IndexArray:
    """(3,) whole ones, none of them negative."""
    return np.array([max(0, ceil(steps)) for steps in lacking])


def _three(numbers: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def main() -> None:
    # numba, which whoever only asks for an answer does not wait for.
    from daemon.host.compilation import forgive_caches

    forgive_caches()
    serve_apart(answer)


if __name__ == "__main__":
    main()
