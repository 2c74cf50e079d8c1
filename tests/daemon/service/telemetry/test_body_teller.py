"""Where the whole body is: told where it is known, and by whom; and that nobody knows it else."""

from collections.abc import Sequence

import numpy as np
import pytest

from daemon.messages import Body
from daemon.service.telemetry.body_teller import MOST_POINTS, spread
from daemon.service.telemetry.emulated_body import told_body
from safety.risk_source import KnownBody, NoModel, body_of
from tests.daemon.service.rig import Rig, on_a_rig


class Knows(NoModel):
    """A source with a body of 100 points, straight up; fails above a position."""

    def __init__(self, number: float = 1.0) -> None:
        super().__init__()
        self.asked: list[list[float]] = []
        self.number = number

    def body(self, u: Sequence[float]) -> KnownBody | None:
        self.asked.append(list(u))
        up = [[0.0, 0.0, float(z)] for z in range(100)]
        covariance = [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
        return KnownBody(up, [4.0] * 100, [self.number], [[0.0, 0.0, 50.0]], [covariance])


class Says(NoModel):
    """A source that says what it is given."""

    def __init__(self, body: KnownBody) -> None:
        super().__init__()
        self._body = body

    def body(self, u: Sequence[float]) -> KnownBody | None:
        return self._body


def told(rig: Rig) -> list[Body]:
    return [message for message in rig.told if isinstance(message, Body)]


async def a_while(rig: Rig) -> None:
    begun = rig.service.clock.now_ns()
    await rig.until(lambda: rig.service.clock.now_ns() - begun > 2_000_000_000)


def test_a_body_that_a_model_knows_is_told_ten_times_a_second_where_the_axes_are() -> None:
    source = Knows()
    axes: list[float | None] = []

    async def scene(rig: Rig) -> None:
        await a_while(rig)
        axes.extend(axis.actual for axis in rig.status.axes)
        source.asked = source.asked[-1:]

    rig = on_a_rig(scene, risk=source)
    bodies = [body for body in told(rig) if body.source == "model"]
    gaps_s = np.diff([body.t_ns for body in bodies]) * 1e-9
    assert gaps_s.min() > 0.099 and np.median(gaps_s) < 0.12
    newest = bodies[-1]
    assert newest.centreline_mm is not None and newest.radius_mm is not None
    assert len(newest.centreline_mm) == len(newest.radius_mm) == MOST_POINTS
    assert newest.centreline_mm[0] == [0.0, 0.0, 0.0] and newest.centreline_mm[-1][2] == 99.0
    assert newest.components is not None
    assert newest.components[0].covariance_mm2 == [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
    assert source.asked[0] == pytest.approx(axes, abs=0.1)


def test_a_rig_without_a_model_says_that_nobody_knows_its_body() -> None:
    rig = on_a_rig(a_while)
    assert told(rig) and {body.source for body in told(rig)} == {"none"}
    assert all(body.centreline_mm is None and body.components is None for body in told(rig))


def test_what_an_emulated_lab_tells_goes_before_what_a_model_expects() -> None:
    true = Body(
        t_ns=1,
        source="emulated truth",
        centreline_mm=[[0.0] * 3, [0.0, 9.0, 9.0]],
        radius_mm=[3.0] * 2,
    )

    async def scene(rig: Rig) -> None:
        rig.service.body.emulated = lambda: true
        await a_while(rig)

    told_so = [one for one in told(on_a_rig(scene, risk=Knows())) if one.source == true.source]
    assert all(one.centreline_mm == true.centreline_mm for one in told_so)
    newest = told_so[-2]  # the last comes when the drives have gone
    assert newest.components is not None, "the model's mixture is told beside it"


def test_a_model_that_fails_or_says_no_numbers_tells_no_body() -> None:
    class Fails(Knows):
        def body(self, u: Sequence[float]) -> KnownBody | None:
            raise ZeroDivisionError

    class Silent(Knows):
        def body(self, u: Sequence[float]) -> KnownBody | None:
            return None

    assert body_of(Fails(), [0.0]) is None
    assert body_of(Silent(), [0.0]) is None
    assert body_of(Knows(float("nan")), [0.0]) is None
    good = Knows().body([0.0])
    assert good is not None and body_of(Knows(), [0.0]) == good
    nowhere, unsure = [[float("inf")] * 3], [float("nan")]
    for broken in (
        good._replace(centreline_mm=nowhere),
        good._replace(means_mm=nowhere),
        good._replace(covariances_mm2=nowhere),
        good._replace(radius_mm=unsure),
        good._replace(weights=unsure),
    ):
        assert body_of(Says(broken), [0.0]) is None


@pytest.mark.parametrize("count", [2, 19, 32, 33, 400])
def test_points_are_spread_from_the_first_to_the_last(count: int) -> None:
    kept = spread(count)
    assert kept[0] == 0 and kept[-1] == count - 1 and len(set(kept)) == min(count, MOST_POINTS)


def test_a_lab_that_tells_no_numbers_tells_no_body() -> None:
    line = [[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]]
    good = told_body({"t_ns": 5, "centreline_mm": line, "body_radius_mm": 4})
    assert good is not None and good.radius_mm == [4.0, 4.0] and good.source == "emulated truth"
    for wrong in (
        {},
        {"centreline_mm": line},
        {"centreline_mm": line[:1], "body_radius_mm": 4},
        {"centreline_mm": [[0.0], [1.0]], "body_radius_mm": 4},
        {"centreline_mm": [*line, ["a", 0, 0]], "body_radius_mm": 4},
        {"centreline_mm": line, "body_radius_mm": float("nan")},
        {"centreline_mm": [*line, [0.0, 0.0, float("inf")]], "body_radius_mm": 4},
    ):
        assert told_body(wrong) is None
