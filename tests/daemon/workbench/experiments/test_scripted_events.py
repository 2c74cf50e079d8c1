"""Loads and faults come when they are due, and once."""

import pytest
from pydantic import ValidationError

from config.tasks.experiment import Happening
from daemon.workbench.experiments.scripted_events import Happenings


class Lab:
    def __init__(self) -> None:
        self.loads: list[float] = []
        self.faults: list[str] = []

    def set_tip_load(self, mass_g: float) -> None:
        self.loads.append(mass_g)

    def inject(self, fault: str) -> None:
        self.faults.append(fault)


def play(planned: list[Happening], seconds: float, cycle_s: float) -> Lab:
    lab = Lab()
    happenings = Happenings(planned, 14.0, lab, lambda _: None)
    for step in range(round(seconds / 0.1)):
        happenings.step(step * 0.1, int(step * 0.1 / cycle_s), 0.1)
    return lab


def test_a_fault_comes_once_at_its_time() -> None:
    assert play([Happening(at_s=2.0, inject="tracker.missing=1s")], 1.9, 10).faults == []
    assert play([Happening(at_s=2.0, inject="tracker.missing=1s")], 5.0, 10).faults == [
        "tracker.missing=1s"
    ]


def test_a_load_fills_up_at_its_rate_and_stops_there() -> None:
    lab = play([Happening(at_cycle=1, tip_load_g=24.0, fill_g_s=2.0)], 10.0, cycle_s=3.0)
    assert lab.loads[0] == pytest.approx(14.2)
    assert lab.loads[-1] == 24.0
    assert len(lab.loads) == pytest.approx(50, abs=1)


def test_without_a_rate_the_load_is_there_at_once() -> None:
    assert play([Happening(at_cycle=0, tip_load_g=30.0)], 1.0, 3.0).loads == [30.0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"inject": "tracker.reset"},
        {"at_s": 1.0, "at_cycle": 1, "inject": "tracker.reset"},
        {"at_s": 1.0},
        {"at_s": 1.0, "inject": "tracker.reset", "tip_load_g": 1.0},
        {"at_s": 1.0, "inject": "tracker.reset", "fill_g_s": 1.0},
    ],
)
def test_a_happening_has_one_time_and_one_thing(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Happening.model_validate(wrong)
