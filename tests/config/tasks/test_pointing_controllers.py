"""A trajectory that says where to point needs a controller that can lead there."""

from typing import Any

import pytest
from pydantic import ValidationError

from config.tasks.experiment import Experiment

CIRCLE: dict[str, Any] = {
    "kind": "circle",
    "center_mm": [36.0, 0.0, 179.0],
    "radius_mm": 15.0,
    "cycle_s": 30.0,
}
POINTING = {"kind": "away_from", "point_mm": [-8.0, -12.0, 136.0]}
POSITION_ONLY = ("iterative_learning", "model_predictive", "pid_constant_curvature")


def experiment(kind: str, **trajectory: object) -> Experiment:
    return Experiment.model_validate(
        {
            "experiment": "circle",
            "robot": "builtin:concentric_tubes",
            "trajectory": {**CIRCLE, **trajectory},
            "controller": {"kind": kind},
        }
    )


@pytest.mark.parametrize("kind", POSITION_ONLY)
def test_who_leads_positions_alone_is_refused_and_told_who_can(kind: str) -> None:
    with pytest.raises(ValidationError, match=f"{kind} leads the tip by its position alone.*take"):
        experiment(kind, pointing=POINTING)
    assert experiment(kind).controller.kind == kind


@pytest.mark.parametrize("kind", ["broyden", "gaussian_process"])
def test_who_points_is_not(kind: str) -> None:
    assert experiment(kind, pointing=POINTING).controller.kind == kind
