"""What `python -m tests.experiments.load_steps` asks, and how it judges what comes of it."""

import pytest

from daemon.workbench.experiments.measures import Recovery
from tests.experiments.load_steps import cases, figures_of, file_of, limit_s


def _back(true_s: float | None, beyond_mm: float = 0.5) -> Recovery:
    return Recovery(
        at_s=6.0,
        load_g=30.0,
        peak_mm=20.0,
        back_s=true_s,
        true_back_s=true_s,
        overshoot_mm=beyond_mm,
    )


def test_each_body_meets_each_load_with_each_seed() -> None:
    asked = list(cases(["worn", "slow"], [15.0, 30.0], 2))
    assert len(asked) == len(set(asked)) == 8
    hung_g = [one.tip_load_g for one in file_of(("worn", 15.0, 1)).experiment.happenings]
    assert hung_g == [15.0, 0.0, 15.0, 0.0]


@pytest.mark.parametrize(("body", "seconds"), [("as_made", 0.7), ("slow", 1.65)])
def test_who_is_late_may_take_the_longer(body: str, seconds: float) -> None:
    assert limit_s(file_of((body, 30.0, 1))) == pytest.approx(seconds)


def test_who_does_not_come_back_is_counted_as_never_and_not_left_out() -> None:
    runs = [[_back(0.5), _back(None)], [_back(0.9, 2.5), _back(None)], [_back(0.6), _back(0.4)]]
    figures = figures_of(runs, 0.7)
    assert figures["true_s"] == [0.6, None]
    assert (figures["within"], figures["changes"]) == (3, 6)
    assert figures["beyond_mm"] == 2.5
