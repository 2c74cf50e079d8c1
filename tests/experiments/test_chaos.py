"""A few pairs of faults in every run of the tests; the experiment notices what is wrong."""

import math
from collections.abc import Sequence

import pytest

from daemon.messages import Event
from tests import SOFT_ARM
from tests.daemon.service.grazing import TENDON_ARM
from tests.experiments.chaos import Life, Outcome, _unnamed, live, lives, table
from tests.experiments.chaos_faults import BESIDE, Fault
from tests.experiments.chaos_limits import (
    AxisLimits,
    ShaftWitness,
    limits_of,
    targets_outside,
)

LIMITS = AxisLimits("one", 2000.0, 0.0, 50.0, 10.0, 100.0)
CYCLE_NS = 10_000_000


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 10], ids=["soft_arm", "tendon_arm"])
def test_three_pairs_of_faults_are_named_and_the_robot_comes_back_each_time(first: int) -> None:
    outcomes = live(Life(2, range(first, first + 3)))
    assert len(outcomes) == 3
    assert not any(one.wrong for one in outcomes), "\n".join(table(outcomes, 2))


def test_every_pair_is_in_one_life_and_both_robots_take_part() -> None:
    shared = lives(35, seed=1)
    assert [number for life in shared for number in life.numbers] == list(range(35))
    assert {life.setting.path for life in shared} == {SOFT_ARM, TENDON_ARM}
    assert Life(1, [17]).setting is shared[1].setting, "a pair alone has the robot it had"


def test_limits_are_those_of_the_file() -> None:
    soft, tendon = limits_of(SOFT_ARM), limits_of(TENDON_ARM)
    assert soft[3, 0] == AxisLimits("proximal_3", 2000.0, 0.0, 50.0, 10.0, 100.0)
    helical = tendon[4, 0]
    assert helical.name == "helical"
    assert helical.counts_per_mm == pytest.approx(4096 * 5.0 / 62.83185307)
    assert (helical.lowest, helical.highest) == (-15.0, 15.0)


def run_of(places_mm: Sequence[float]) -> list[tuple[int, int]]:
    """Targets in counts, one for each cycle."""
    return [(k * CYCLE_NS, round(mm * LIMITS.counts_per_mm)) for k, mm in enumerate(places_mm)]


def at_speeds(speeds_mm_s: Sequence[float], start_mm: float = 20.0) -> list[tuple[int, int]]:
    places = [start_mm]
    for speed in speeds_mm_s:
        places.append(places[-1] + speed * 0.01)
    return run_of(places)


def kinds_outside(run: Sequence[tuple[int, int]]) -> set[str]:
    return {one.what for one in targets_outside(LIMITS, run)}


def test_a_motion_at_its_limits_is_within_them() -> None:
    ramp = [min(10.0, 1.0 * k) for k in range(30)]
    assert kinds_outside(at_speeds([*ramp, *reversed(ramp)])) == set()
    assert kinds_outside(run_of([50.0, 50.0])) == set()


def test_what_is_outside_is_found() -> None:
    assert kinds_outside(run_of([49.99, 50.01])) == {"target"}
    assert kinds_outside(run_of([0.01, -0.01])) == {"target below"}
    assert kinds_outside(run_of([50.5, 50.45, 50.4])) == set(), "it comes back"
    assert "velocity" in kinds_outside(at_speeds([10.5] * 5))
    assert kinds_outside(at_speeds([0.0] * 5 + [5.0] * 5)) == {"acceleration"}
    assert kinds_outside(at_speeds([5.0] * 5 + [0.0] * 5)) == {"acceleration"}
    slowly_too_fast = [0.13 * 10 * k / 10 for k in range(60)]  # 13 mm/s in a second
    assert kinds_outside(at_speeds(slowly_too_fast)) == set(), "it is within 100 mm/s²"


def test_shafts_are_looked_at_where_they_really_are() -> None:
    shafts = ShaftWitness([LIMITS])
    for k, mm in enumerate((49.9, 50.0, 50.1)):
        shafts.look(k * 0.01, [mm * LIMITS.counts_per_mm])
    assert shafts.take_outside() == []
    shafts.look(0.03, [50.3 * LIMITS.counts_per_mm])
    assert [one.what for one in shafts.take_outside()] == ["shaft", "shaft's velocity"]
    assert shafts.take_outside() == []
    shafts.look(0.04, [-0.3 * LIMITS.counts_per_mm])
    assert {one.what for one in shafts.take_outside()} == {"shaft below", "shaft's velocity"}


def test_a_shaft_that_comes_free_may_catch_up_with_its_target() -> None:
    """With a lag of 4 ms, which takes some looks."""
    shafts = ShaftWitness([LIMITS])
    places_mm = [20.0, 20.0, *(20.5 + 0.5 * (1.0 - math.exp(-2.5 * k)) for k in range(4))]
    for k, mm in enumerate(places_mm):
        shafts.look(k * 0.01, [mm * LIMITS.counts_per_mm], [k < 2])
    assert shafts.take_outside() == []
    shafts.look(0.07, [21.0 * LIMITS.counts_per_mm], [False])
    assert shafts.take_outside() == []
    shafts.look(0.08, [21.5 * LIMITS.counts_per_mm], [False])
    assert [one.what for one in shafts.take_outside()] == ["shaft's velocity"]


def event(kind: str, name: str, text: str = "so it is", detail: str = "") -> Event:
    return Event(
        sequence=0, t_ns=0, kind=kind, name=name, subject="", present=True, text=text, detail=detail
    )


async def _nothing(_: object) -> None:
    """A fault that is none."""


LOUD = Fault("tracker.hang", "hang", 0.0, _nothing)
QUIET = Fault("tracker.garbage=1", "garbage", 0.0, _nothing)


def test_what_happens_without_a_word_is_wrong() -> None:
    assert list(_unnamed([QUIET, QUIET], [])) == []
    assert list(_unnamed([QUIET, LOUD], [])) == ["nothing was said"]
    assert list(_unnamed([QUIET, LOUD], [event("condition", "silent")])) == []
    (wrong,) = _unnamed([QUIET, QUIET], [event("state", "hold")])
    assert "without any reason" in wrong
    asked = [event("command", "stop"), event("state", "standby")]
    assert list(_unnamed([QUIET, QUIET], asked)) == []
    broken = event("cause", "internal_error", detail="control step: ValueError")
    assert "internal_error: control step: ValueError" in list(_unnamed([LOUD, LOUD], [broken]))
    assert "silent has no text" in list(_unnamed([LOUD, LOUD], [event("condition", "silent", "")]))


def test_the_table_says_what_was_wrong_and_how_to_see_it_again() -> None:
    good = Outcome(3, "soft_arm", ["tracker.hang"], ["hold", "armed"], ["silent"], [], 2.5)
    bad = Outcome(4, "soft_arm", ["bus.can0.off"], ["fault"], ["bus_off"], ["locked: fault"], None)
    told = "\n".join(table([good, bad], seed=9))
    assert "--seed 9 --only 4" in told
    assert "LOCKED" in told
    assert "2 pairs: 1 back to running, 1 locked, 1 with something wrong" in told


def test_everything_beside_the_devices_has_a_name_of_its_own() -> None:
    assert len({one.name for one in BESIDE}) == len(BESIDE)
