"""Coupled limits come to by hand, through the daemon, the gate and emulated drives."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
import yaml

from config.robot import Robot
from daemon.control.controller import Observation, Proposal
from daemon.messages import Acquire, Hold, Home, Resume, Stop
from daemon.robot.axes import AxisRanges
from daemon.robot.coordinates import Coordinates
from drivers.pose import Vector
from safety.states import OperatingState
from tests.daemon.service.rig import Rig, on_a_rig
from tests.experiments.coupled_gate import TUBES, OwnReading

OWN = OwnReading(TUBES)
PI = float(np.pi)
HERE = {"kind": "hold", "position_mm": [60.0, 0.0, 170.0], "duration_s": 1000.0}
REASONS = {
    "collar_clearance": "the inner tube's collar would come against the pair's",
    "snap_guard": "tube 3 bends against the pair and would snap",
}
_SETTLED = 0.01
"""mm by which drives may pass where they were told to be."""


class Hand:
    """Goes to coordinates as fast as it may, whatever is in the way. Knows nothing of limits."""

    name, ready = "hand", False

    def __init__(self, rig: Rig, q: tuple[float, ...], share: float = 1.0) -> None:
        """share: of the axes' highest velocities."""
        self._share = share
        self._coordinates = coordinates = Coordinates.of(rig.service.robot)
        self._axes = AxisRanges.of(rig.service.robot)
        self.goal = coordinates.axes(np.array(q))

    def to(self, *q: float) -> None:
        self.goal = self._coordinates.axes(np.array(q))

    def reset(self, observation: Observation) -> None:
        pass

    def observe(self, observation: Observation) -> None:
        pass

    def propose(self, observation: Observation) -> Proposal:
        way = self.goal - observation.targets
        return Proposal(self._axes.slowed(way, self._share * observation.dt_s))

    def learn(self) -> None:
        pass

    def save(self, path: Path) -> None:
        raise NotImplementedError

    def load(self, path: Path) -> None:
        raise NotImplementedError


class Watched:
    """Everything that the drives were told, and where they were, cycle by cycle."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.told: list[list[int]] = []
        self.been: list[list[float]] = []

    async def until_rest(self, within_s: float, still_s: float = 0.6) -> Vector:
        """(m,) where the axes are told to be when that has not changed for `still_s`."""
        still = round(still_s / 0.01)
        for number in range(round(within_s / 0.01)):
            await asyncio.sleep(0.01)
            channels = self._rig.service.loop.channels
            self.told.append([channel.target_counts or 0 for channel in channels])
            self.been.append(self._rig.shafts())
            if number > 2 * still and self.told[-still] == self.told[-1]:
                break
        return np.asarray(np.array(self.told[-1]) * OWN.units_per_count)


CASES = [
    # The collars, drawn out by both carriages at once.
    ((0.0, 0.0, 0.0, 0.0, 75.0), (0.0, 0.0, 0.0, -10.0, 87.0), "collar_clearance", (4, 86.5)),
    # The inner tube drawn into the pair.
    ((0.0, 0.0, 0.0, 0.0, 12.0), (0.0, 0.0, 0.0, 10.0, 0.0), "collar_clearance", (4, 0.5)),
    # Tube 3 against the pair, drawn in; and the same a turn further, rolled.
    ((0.0, 0.0, PI, 0.0, 30.0), (0.0, 0.0, PI, 0.0, 5.0), "snap_guard", (4, 25.0)),
    ((1.0, 0.4, 0.2 - PI, 0.0, 30.0), (1.0, 0.4, 0.2 - PI, 5.0, 5.0), "snap_guard", (4, 25.0)),
    # Drawn in, tube 3 turned against the pair; or the pair against tube 3.
    ((0.0, 0.0, 1.0, 6.0, 5.0), (0.0, 0.0, PI, 6.0, 5.0), "snap_guard", (2, 3.1416 - 1.2)),
    ((0.0, 1.8, PI, 0.0, 30.0), (0.0, 0.0, PI, 0.0, 5.0), "snap_guard", None),
]


@pytest.mark.parametrize(("start", "goal", "limit", "stops"), CASES)
def test_a_limit_come_to_by_hand_is_kept_named_and_left_again(
    start: tuple[float, ...],
    goal: tuple[float, ...],
    limit: str,
    stops: tuple[int, float] | None,
) -> None:
    async def scene(rig: Rig) -> None:
        coordinates = Coordinates.of(rig.service.robot)
        hand, watched = Hand(rig, start), Watched(rig)
        await rig.running(HERE, {"kind": "broyden"})
        rig.service.loop.controller = hand
        await watched.until_rest(30.0)
        assert rig.in_state(OperatingState.RUNNING), rig.events("cause", "gate_refused")[-1].detail
        hand.to(*goal)
        at = coordinates.of_axes(await watched.until_rest(30.0))
        await rig.until_state(OperatingState.HOLD)
        (refusal,) = rig.events("cause", "gate_refused")
        assert f"coupled limit: {limit} ({REASONS[limit]})" in refusal.detail
        if stops is not None:
            assert at[stops[0]] == pytest.approx(stops[1], abs=0.01)
        hand.to(*start)
        await rig.do(Resume)
        back = coordinates.of_axes(await watched.until_rest(30.0))
        np.testing.assert_allclose(back, start, atol=0.01)
        assert rig.in_state(OperatingState.RUNNING)
        assert OWN.outside(np.array(watched.told)) <= 0.0
        assert OWN.outside(np.array(watched.been)) <= _SETTLED

    on_a_rig(scene, path=TUBES)


def homes_inwards(robot: Robot) -> Robot:
    """The inner carriage looks for a switch that is 10 mm beyond where its collar may go."""
    inner = robot.axes[4]
    homing = inner.homing.model_copy(update={"method": 17, "timeout_s": 60.0})
    collars = robot.coupled_limits[0].model_copy(update={"lowest_mm": 20.0})
    return robot.model_copy(
        update={
            "axes": [*robot.axes[:4], inner.model_copy(update={"homing": homing})],
            "coupled_limits": [collars, robot.coupled_limits[1]],
        }
    )


def test_homing_ends_where_a_coupled_limit_does() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        refusal = await rig.refused(Home, axes=["carriage_inner"])
        assert refusal.name == "not_homed"
        assert "carriage_inner: stopped at -33.5" in refusal.text
        assert "a coupled limit ends there, with the other axes where they are" in refusal.text
        assert -33.7 < rig.shafts()[4] * OWN.units_per_count[4] < -33.4

    on_a_rig(scene, path=TUBES, change=homes_inwards, begins_in=OperatingState.READY)


def test_a_base_roll_moves_all_rotations_in_the_same_cycles() -> None:
    """From rest, at speed, and through a hold: within the rounding of steps, 0.3 mrad."""

    async def scene(rig: Rig) -> None:
        hand, watched = Hand(rig, (0.0, 0.5, 1.0, 0.0, 53.5), 0.3), Watched(rig)
        await rig.running(HERE, {"kind": "broyden"})
        rig.service.loop.controller = hand
        await watched.until_rest(30.0)
        await watched.until_rest(30.0)
        hand.to(1.5, 0.5, 1.0, 0.0, 53.5)
        first = len(watched.told)
        resumed = asyncio.create_task(watched.until_rest(20.0, still_s=1.2))
        await asyncio.sleep(0.7)
        await rig.do(Hold)
        await asyncio.sleep(1.0)
        await rig.do(Resume)
        u = await resumed
        np.testing.assert_allclose(u[:3], [1.5, 2.0, 2.5], atol=1e-3)
        for places, slack in ((watched.told, 8), (watched.been, 12)):
            rotations = np.array(places[first:])[:, :3]
            apart = rotations - rotations[0]
            assert np.ptp(apart, axis=1).max() <= slack
            assert apart.max() > 40_000

    on_a_rig(scene, path=TUBES)


def quick_stop_ways() -> dict[str, float]:
    """What each axis goes at the most while it stops by itself, mm or rad, by the file's words."""
    axes = yaml.safe_load(TUBES.read_text())["axes"]
    return {
        axis["name"]: axis[f"max_velocity_{unit}_s"] ** 2
        / (2.0 * axis[f"quick_stop_deceleration_{unit}_s2"])
        for axis in axes
        for unit in ("rad", "mm")
        if f"max_velocity_{unit}_s" in axis
    }  # fmt: skip


def widened_by_quick_stops() -> tuple[OwnReading, dict[str, list[float]]]:
    """The limits, each bound and each condition given way by what its axes go; and by how much."""
    own, ways = OwnReading(TUBES), np.array(list(quick_stop_ways().values()))
    given: dict[str, list[float]] = {}

    def way(named: dict[str, float]) -> float:
        ends = own.sum_of(named, np.eye(len(ways)) / own.units_per_count)
        return float(np.abs(ends - own.sum_of(named, np.zeros((1, len(ways))))) @ ways)

    for limit in own.limits:
        conditions = limit.get("only_while", [])
        given[limit["name"]] = [way(one["sum"]) for one in (limit, *conditions)]
        limit["lowest_mm"] -= given[limit["name"]][0]
        limit["highest_mm"] = limit.get("highest_mm", np.inf) + given[limit["name"]][0]
        for condition in conditions:
            condition["within_rad"] -= way(condition["sum"])
    return own, given


def test_what_quick_stops_go_is_less_than_what_the_limits_keep_free() -> None:
    """Collars touch 0.5 mm beyond their limits; bodies 6 % off snap less than 0.9 rad from π."""
    _, given = widened_by_quick_stops()
    assert given["collar_clearance"] == [pytest.approx(0.125)]
    assert given["snap_guard"] == [pytest.approx(0.125), pytest.approx(0.05), pytest.approx(0.05)]


STOPPED = [
    # Turned against the pair, whose tubes roll the other way; and drawn in by both carriages.
    ((0.0, 0.0, 1.2, 6.0, 5.0), (-1.5, 0.5, PI, 6.0, 5.0)),
    ((0.0, 0.0, PI, 0.0, 30.0), (0.0, 0.4, PI, 5.0, 5.0)),
]


@pytest.mark.parametrize("short_of", [0.3, 0.01])
@pytest.mark.parametrize(("start", "goal"), STOPPED)
def test_drives_that_stop_each_at_its_own_rate_near_a_limit_stay_within_their_margin(
    start: tuple[float, ...], goal: tuple[float, ...], short_of: float
) -> None:
    """STOP so many rad or mm before the limit, at speed."""
    wide, _ = widened_by_quick_stops()
    guard = OWN.limits[1]

    def left(counts: list[int]) -> float:
        """rad or mm to the guard, whichever of its sums is the last that keeps it."""
        place = np.array([counts], np.float64)
        (above,) = OWN.sum_of(guard["sum"], place) - guard["lowest_mm"]
        beside = max(
            abs(float(np.angle(np.exp(1j * (OWN.sum_of(one["sum"], place)[0] - one["near_rad"])))))
            - one["within_rad"]
            for one in guard["only_while"]
        )
        return max(float(above), float(beside))

    async def scene(rig: Rig) -> None:
        hand, watched = Hand(rig, start), Watched(rig)
        await rig.running(HERE, {"kind": "broyden"})
        rig.service.loop.controller = hand
        await watched.until_rest(30.0)
        hand.to(*goal)

        def told() -> list[int]:
            return [channel.target_counts or 0 for channel in rig.service.loop.channels]

        await rig.until(lambda: left(told()) < short_of, 30.0)
        before = np.array(told())
        await rig.do(Stop)
        for _ in range(100):
            await asyncio.sleep(0.005)
            watched.been.append(rig.shafts())
        assert np.abs(np.array(watched.been[-1]) - before).max() > 10, "nothing moved any more"
        assert wide.outside(np.array(watched.been)) <= _SETTLED

    on_a_rig(scene, path=TUBES)
