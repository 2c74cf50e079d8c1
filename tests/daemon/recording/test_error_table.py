"""The table of errors says what the plain formulas say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.messages import Tip
from daemon.recording.result import ErrorTable, table_text


def tip(error_mm: float | None, cycle: int = 0, state: str = "running") -> Tip:
    return Tip(
        sequence=0,
        t_ns=0,
        state=state,
        measured_mm=None,
        tip_mm=None,
        velocity_mm_s=None,
        quaternion=None,
        reference_mm=None,
        error_mm=error_mm,
        cycle=cycle,
    )


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.floats(0, 1e3)), min_size=1, max_size=60))
def test_mean_spread_and_worst_of_each_cycle(samples: list[tuple[int, float]]) -> None:
    table = ErrorTable()
    for cycle, error_mm in samples:
        table.add(tip(error_mm, cycle))
    rows = table.rows()
    assert [row.cycle for row in rows] == sorted({cycle for cycle, _ in samples})
    for row in rows:
        mine = np.array([error_mm for cycle, error_mm in samples if cycle == row.cycle])
        assert row.samples == len(mine)
        assert row.mean_mm == pytest.approx(mine.mean(), abs=1e-9)
        assert row.std_mm == pytest.approx(mine.std(), abs=1e-6)
        assert row.max_mm == mine.max()


@pytest.mark.parametrize(
    "left_out",
    [tip(1.0, state="hold"), tip(1.0, cycle=-1), tip(None), tip(float("nan")), tip(float("inf"))],
)
def test_only_errors_while_following_count(left_out: Tip) -> None:
    table = ErrorTable()
    table.add(left_out)
    assert table.rows() == []
    assert str(table) == "no cycle was followed"


def test_people_count_cycles_from_one() -> None:
    table = ErrorTable()
    table.add(tip(2.0))
    table.add(tip(4.0))
    head, row = table_text(table.rows()).splitlines()
    assert head.split() == ["cycle", "samples", "mean", "mm", "std", "mm", "max", "mm"]
    assert row.split() == ["1", "2", "3.000", "1.000", "4.000"]
    assert len(head) == len(row)
