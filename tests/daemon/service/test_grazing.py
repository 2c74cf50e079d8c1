"""What stands a little in the way is gone along, and nothing is touched. See `grazing`."""

from dataclasses import replace
from pathlib import Path

import pytest

from safety.states import OperatingState
from tests.daemon.service.grazing import TENDONS, Grazed, graze

pytestmark = pytest.mark.usefixtures("shared_grids")

BRISKLY = replace(TENDONS, circle={**TENDONS.circle, "cycle_s": 12.0})


def grazed(folder: Path, aware: bool, slide: bool = True) -> Grazed:
    """One of the scenes, round in less time."""
    return graze(3, folder, aware, slide, BRISKLY)


def test_it_goes_along_what_stands_in_its_way_and_touches_nothing(tmp_path: Path) -> None:
    found = grazed(tmp_path, aware=True)
    assert (found.state, found.causes) == (OperatingState.ARMED, set()), "it got round"
    assert found.least_clearance_mm > 0.0
    assert found.slid > 50
    assert found.mean_error_mm < 3.0


@pytest.mark.long
def test_without_the_model_the_same_way_touches(tmp_path: Path) -> None:
    found = grazed(tmp_path, aware=False)
    assert found.state is OperatingState.ARMED
    assert found.least_clearance_mm < -1.0
    assert found.slid == 0


def test_who_is_not_to_slide_takes_shorter_steps_and_holds(tmp_path: Path) -> None:
    found = grazed(tmp_path, aware=True, slide=False)
    assert (found.state, found.causes) == (OperatingState.HOLD, {"risk_too_high"})
    assert found.least_clearance_mm > 0.0
    assert found.shortened > 3
    assert found.slid == 0
