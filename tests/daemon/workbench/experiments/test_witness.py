"""The witness keeps every step within a cycle, whole, with the truth beside it."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from config.loader import load_robot
from daemon.messages import Axes, Tip
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.carry_out import Witness
from daemon.workbench.experiments.step_statistics import Array, StepSeries
from tests import SOFT_ARM


class Truth:
    def __init__(self) -> None:
        self.at = np.zeros(3)

    def tip_mm(self) -> Array:
        return self.at

    def direction(self) -> Array:
        return np.array([0.0, 0.0, 1.0])

    def failures(self) -> int:
        return 0


def tip(sequence: int, cycle: int = 0, state: str = "running", x: float | None = 1.0) -> Tip:
    place = None if x is None else [x, 0.0, 0.0]
    return Tip(
        sequence=sequence,
        t_ns=sequence,
        state=state,
        measured_mm=place,
        tip_mm=[float(sequence), 0.0, 0.0],
        velocity_mm_s=None,
        quaternion=None,
        reference_mm=[0.0, 0.0, 0.0],
        error_mm=float(sequence),
        cycle=cycle,
    )


def axes(sequence: int, place: float = 25.0) -> Axes:
    return Axes(
        sequence=sequence,
        t_ns=sequence,
        actual=[place] * 6,
        target=[place] * 6,
        proposed=None,
        permitted=None,
        force=[0.0] * 6,
    )


@pytest.fixture
def witness() -> Witness:
    return Witness(AxisRanges.of(load_robot(SOFT_ARM).robot), Truth(), lambda: 3.5)


def test_a_step_is_kept_with_where_everything_was(witness: Witness) -> None:
    truth = witness._truth
    assert isinstance(truth, Truth)
    truth.at = np.array([0.1, 0.2, 0.3])
    witness.hear_tip(tip(7, cycle=2))
    witness.hear_axes(axes(7, place=12.5))
    (step,) = [witness.series()]
    assert (step.t_s.tolist(), step.cycle.tolist()) == ([3.5], [2.0])
    assert step.tip_mm.tolist() == [[7.0, 0.0, 0.0]]
    assert step.reading_mm.tolist() == [[1.0, 0.0, 0.0]]
    assert step.true_mm.tolist() == [[0.1, 0.2, 0.3]]
    assert step.u.tolist() == [[0.25] * 6]
    assert step.error_mm.tolist() == [7.0]


@pytest.mark.parametrize("left_out", [tip(1, cycle=-1), tip(1, state="hold")])
def test_what_is_no_step_of_a_cycle_is_left_out(witness: Witness, left_out: Tip) -> None:
    witness.hear_tip(left_out)
    witness.hear_axes(axes(1))
    assert len(witness.series().t_s) == 0


def test_axes_of_another_step_belong_to_nothing(witness: Witness) -> None:
    witness.hear_tip(tip(1))
    witness.hear_axes(axes(2))
    witness.hear_axes(axes(1))
    assert len(witness.series().t_s) == 0


def test_a_frame_without_a_reading_still_counts(witness: Witness) -> None:
    witness.hear_tip(tip(1, x=None))
    witness.hear_axes(axes(1))
    assert np.isnan(witness.series().reading_mm).all()
    assert witness.series().error_mm.tolist() == [1.0]


def test_what_the_controller_expects_is_kept_and_that_it_says_nothing(witness: Witness) -> None:
    for number, expected_mm in enumerate((0.4, None)):
        witness.hear_tip(msgspec.structs.replace(tip(number), expected_mm=expected_mm))
        witness.hear_axes(axes(number))
    assert witness.series().expected_mm.tolist() == pytest.approx([0.4, np.nan], nan_ok=True)


def test_steps_are_saved_and_found_again(witness: Witness, tmp_path: Path) -> None:
    for number in range(5):
        witness.hear_tip(tip(number, cycle=number // 3))
        witness.hear_axes(axes(number, place=10.0 * number))
    made = witness.series()
    made.save(tmp_path / "steps.npz")
    found = StepSeries.load(tmp_path / "steps.npz")
    assert found.cycles == [0, 1]
    np.testing.assert_allclose(found.u, made.u, atol=1e-6)
    np.testing.assert_allclose(found.tip_mm, made.tip_mm, atol=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == ["steps.npz"]
