"""Random pairs of faults while the robot moves: named, within limits, and back without a restart.

`python -m tests.experiments.chaos --pairs 200 --seed 1`, in virtual time, with the whole daemon and
both robots that are shipped. One daemon lives through several pairs. Each pair is drawn from its
own number, so that `--seed 1 --only 17` plays that one again alone; `--life` plays all that its
daemon had lived through before, too. Ends with exit code 1 where anything was wrong.

After the faults are over and what needs a hand is mended (`chaos_faults.mend`), somebody does what
the states ask for: clear, arm, load and start, or resume. The robot must be RUNNING then.
"""

import argparse
import asyncio
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from daemon.host.processes import worker_processes
from daemon.messages import (
    Acquire,
    Answer,
    Arm,
    Clear,
    Disarm,
    Event,
    Load,
    Resume,
    Start,
)
from drivers.axis_scale import axis_scale
from safety.causes import Severity
from safety.states import OperatingState
from sim_backends.devices.drive.axis.shaft import Shaft
from tests import SOFT_ARM
from tests.daemon.service.grazing import BROYDEN, TENDON_ARM
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, USER, Rig, on_a_rig
from tests.experiments.chaos_faults import Fault, FlakyRisk, World, drawn, kinds, mend
from tests.experiments.chaos_limits import Outside, ShaftWitness, TargetWitness, in_order

S = OperatingState
FAULT: Final = Severity.FAULT

_PAIRS_OF_A_LIFE: Final = 10
_MOVING_S: Final = (1.0, 4.0)
"""So long the robot moves before the first of a pair."""
_APART_S: Final = 1.5
_LOOKED_AT_S: Final = 1.0
"""After both faults are over, before somebody mends what they left."""
_BACK_WITHIN_S: Final = 90.0
_STAYS_S: Final = 1.0
_SHAFTS_EVERY_S: Final = 0.01
_SLACK: Final = "tendon_slack"
_PULLS: Final = 30
_PULL_MM: Final = 0.04
"""Of tendon, each time: a hand that is slower than the motor may be."""


@dataclass(frozen=True)
class Setting:
    """A robot, and what it does."""

    path: Path
    trajectory: dict[str, Any]
    controller: dict[str, Any]


SETTINGS: Final = (
    Setting(SOFT_ARM, SMALL_CIRCLE | {"radius_mm": 25.0, "cycles": 1000}, MODEL),
    Setting(
        TENDON_ARM,
        {
            "kind": "circle",
            "center_mm": [0.0, 0.0, 197.5],
            "plane": "xy",
            "radius_mm": 15.0,
            "cycle_s": 20.0,
            "cycles": 1000,
        },
        BROYDEN,
    ),
)


@dataclass
class Outcome:
    """What became of one pair."""

    number: int
    robot: str
    orders: list[str]
    states: list[str] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    back_s: float | None = None
    """From mended to RUNNING."""


@dataclass
class Life:
    """One daemon, and the pairs that it goes through."""

    seed: int
    numbers: Sequence[int]
    outcomes: list[Outcome] = field(default_factory=list)

    @property
    def setting(self) -> Setting:
        return SETTINGS[self.numbers[0] // _PAIRS_OF_A_LIFE % len(SETTINGS)]


def live(life: Life) -> list[Outcome]:
    """All pairs of a life, up to the first from which the robot does not come back."""
    setting = life.setting
    recorder, risk = TargetWitness(setting.path), FlakyRisk()

    async def scene(rig: Rig) -> None:
        errors: list[str] = []
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: errors.append(str(context.get("exception", context["message"])))
        )
        world = World(rig, recorder, risk)
        shafts = ShaftWitness(in_order(recorder.limits, list(rig.lab.drives)))
        watching = asyncio.create_task(_watch(rig, shafts))
        try:
            await back_to_running(rig, setting)
            for number in life.numbers:
                outcome = await _pair(world, setting, life.seed, number)
                outcome.wrong += [f"an error of its own: {error}" for error in errors]
                outcome.wrong += map(str, _outside(recorder, shafts))
                errors.clear()
                life.outcomes.append(outcome)
                if outcome.back_s is None:
                    return
        finally:
            watching.cancel()

    on_a_rig(scene, path=setting.path, risk=risk, seed=life.seed, recorder=recorder)
    return life.outcomes


async def _pair(world: World, setting: Setting, seed: int, number: int) -> Outcome:
    rig = world.rig
    random = np.random.default_rng([seed, number])
    table = kinds(rig.lab.devices)
    pair = [drawn(table[k], rig.lab.devices, random) for k in random.integers(len(table), size=2)]
    outcome = Outcome(number, rig.service.robot.robot, [fault.order for fault in pair])
    await asyncio.sleep(float(random.uniform(*_MOVING_S)))
    before, apart_s = len(rig.told), float(random.uniform(0.0, _APART_S))
    await pair[0].carry_out(world)
    await asyncio.sleep(apart_s)
    await pair[1].carry_out(world)
    await asyncio.sleep(max(pair[0].lasts_s - apart_s, pair[1].lasts_s) + _LOOKED_AT_S)
    await mend(world)
    mended_ns = rig.service.clock.now_ns()
    try:
        await back_to_running(rig, setting)
        outcome.back_s = (rig.service.clock.now_ns() - mended_ns) * 1e-9
    except AssertionError as error:
        outcome.wrong.append(f"locked: {error}")
    events = [one for one in rig.told[before:] if isinstance(one, Event)]
    outcome.states = [one.name for one in events if one.kind == "state"]
    outcome.named = list(dict.fromkeys(_names(events)))
    outcome.wrong += _unnamed(pair, events)
    rig.forget()
    return outcome


def _names(events: Sequence[Event]) -> Iterator[str]:
    return (one.name for one in events if one.kind in ("cause", "condition") and one.present)


def _unnamed(pair: Sequence[Fault], events: Sequence[Event]) -> Iterator[str]:
    """What happened without a word, or by a defect."""
    named = set(_names(events))
    asked = {one.name for one in events if one.kind == "command"}
    stops = {S.HOLD.value, S.FAULT.value, S.ESTOP.value, S.STANDBY.value}
    stopped = [one for one in events if one.kind == "state" and one.name in stops]
    if stopped and not named and not asked & {"stop", "disarm", "hold"}:
        yield f"it went to {stopped[0].name} without any reason"
    if not named and not all(fault.may_pass or fault.kind in _ASKED for fault in pair):
        yield "nothing was said"
    if "internal_error" in named:
        details = [one.detail for one in events if one.name == "internal_error"]
        yield f"internal_error: {details[0]}"
    for one in events:
        if one.kind in ("cause", "condition") and one.present and not one.text:
            yield f"{one.name} has no text"


_ASKED: Final = frozenset({"operator_hold", "operator_stop", "operator_disarm"})
"""Told as commands."""


async def back_to_running(rig: Rig, setting: Setting) -> None:
    """What somebody at the desk would do, until the robot moves and goes on moving.

    Raises AssertionError where it does not come to that.
    """
    clock = rig.service.clock
    end_ns = clock.now_ns() + round(_BACK_WITHIN_S * 1e9)
    refused = ""
    while True:
        if rig.state is S.RUNNING:
            await asyncio.sleep(_STAYS_S)
            if rig.state is S.RUNNING:
                return
        if _SLACK in rig.causes:
            await _tension_by_hand(rig)
        answer = await _next_step(rig, setting)
        if not isinstance(answer, Answer | None):
            reasons = ", ".join(reason.name for reason in answer.reasons)
            refused = f"{answer.name}: {answer.text} [{reasons}]"
        await asyncio.sleep(0.25)
        assert clock.now_ns() < end_ns, f"{rig.state.value} by {sorted(rig.causes)}; {refused}"


async def _tension_by_hand(rig: Rig) -> None:
    """As the remedy says: the robot does not move while a tendon hangs loose."""
    loose = {one.subject for one in rig.service.supervisor.reasons if one.cause.value == _SLACK}
    await rig.ask(Disarm(token=rig.token))
    for _ in range(_PULLS):
        for axis, shaft in zip(rig.service.robot.axes, _shafts(rig), strict=True):
            if axis.name in loose and not shaft.energised:
                scale = axis_scale(axis)
                shaft.drag_to(shaft.position + scale.magnitude(_PULL_MM))
        await asyncio.sleep(_SHAFTS_EVERY_S)


def _shafts(rig: Rig) -> list[Shaft]:
    return [axis.shaft for drive in rig.lab.drives.values() for axis in drive.axes]


async def _next_step(rig: Rig, setting: Setting) -> Any:
    """One command, as the state asks for it."""
    if not rig.service.lease.holds(rig.token, USER, rig.service.clock.now_ns()):
        rig.token = ""
        answer = await rig.ask(Acquire())
        rig.token = getattr(answer, "token", "") or ""
        return answer
    token = rig.token
    if rig.state in (S.FAULT, S.ESTOP):
        return await rig.ask(Clear(token=token))
    if rig.state is S.READY:
        return await rig.ask(Arm(token=token))
    if rig.state is S.STANDBY:
        latched = [reason.cause.severity for reason in rig.service.supervisor.reasons]
        return await rig.ask(Clear(token=token)) if max(latched, default=0) >= FAULT else None
    reference = rig.service.loop.reference
    if rig.state is S.HOLD or (reference is not None and not reference.finished):
        answer = await rig.ask(Resume(token=token))
        if isinstance(answer, Answer):
            return answer
    if rig.state is S.ARMED:
        load = Load(token=token, trajectory=setting.trajectory, controller=setting.controller)
        answer = await rig.ask(load)
        return await rig.ask(Start(token=token)) if isinstance(answer, Answer) else answer
    return None


async def _watch(rig: Rig, shafts: ShaftWitness) -> None:
    while True:
        jammed = [shaft.blocked for shaft in _shafts(rig)]
        shafts.look(rig.service.clock.now_ns() * 1e-9, rig.shafts(), jammed)
        await asyncio.sleep(_SHAFTS_EVERY_S)


def _outside(recorder: TargetWitness, shafts: ShaftWitness) -> list[Outside]:
    return [*recorder.take_outside(), *shafts.take_outside()]


def lives(pairs: int, seed: int) -> list[Life]:
    """So many pairs, shared out."""
    firsts = range(0, pairs, _PAIRS_OF_A_LIFE)
    return [Life(seed, range(k, min(pairs, k + _PAIRS_OF_A_LIFE))) for k in firsts]


def to_its_end(life: Life) -> list[Outcome]:
    """All pairs of a life: where the robot is locked up, another daemon goes on with the rest."""
    outcomes: list[Outcome] = []
    numbers = list(life.numbers)
    while numbers:
        lived = live(Life(life.seed, numbers))
        if not lived:
            raise AssertionError(f"pairs {numbers} of seed {life.seed}: it never ran")
        outcomes += lived
        numbers = numbers[len(lived) :]
    return outcomes


def table(outcomes: Sequence[Outcome], seed: int) -> Iterator[str]:
    """One line for each pair, then what was wrong and how to see it again, then the sum."""
    for one in outcomes:
        back = "LOCKED" if one.back_s is None else f"{one.back_s:5.1f} s"
        worst = max(one.states, key=_RANK.index, default="-")
        verdict = "WRONG" if one.wrong else "ok"
        yield (
            f"{one.number:4} {one.robot:10} {verdict:5} {worst:8} {back:>8}  "
            + " + ".join(one.orders)
            + f"  -> {', '.join(one.named) or 'nothing'}"
        )
    failures = [one for one in outcomes if one.wrong]
    for one in failures:
        yield f"\npair {one.number}: {' + '.join(one.orders)}"
        yield from (f"  {wrong}" for wrong in one.wrong)
        yield f"  again: python -m tests.experiments.chaos --seed {seed} --only {one.number}"
        yield f"  or, with what came before: ... --seed {seed} --life {one.number}"
    locked = sum(one.back_s is None for one in outcomes)
    causes = Counter(name for one in outcomes for name in one.named)
    yield f"\nnamed: {', '.join(f'{name} {count}' for name, count in causes.most_common())}"
    yield (
        f"{len(outcomes)} pairs: {len(outcomes) - locked} back to running, {locked} locked, "
        f"{len(failures)} with something wrong"
    )


_RANK: Final = ["-", *(state.value for state in (S.READY, S.RUNNING, S.ARMED)), S.HOLD.value,
                S.STANDBY.value, S.FAULT.value, S.ESTOP.value]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.chaos", description=__doc__)
    parser.add_argument("--pairs", type=int, default=200, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--only", type=int, metavar="NUMBER", help="this pair alone")
    parser.add_argument("--life", type=int, metavar="NUMBER", help="this pair and those before it")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    arguments = parser.parse_args()
    if arguments.only is not None:
        asked = [Life(arguments.seed, [arguments.only])]
    elif arguments.life is not None:
        first = arguments.life // _PAIRS_OF_A_LIFE * _PAIRS_OF_A_LIFE
        asked = [Life(arguments.seed, range(first, arguments.life + 1))]
    else:
        asked = lives(arguments.pairs, arguments.seed)
    if len(asked) == 1:
        found = [to_its_end(asked[0])]
    else:
        with worker_processes(arguments.processes) as workers:
            found = list(workers.map(to_its_end, asked))
    outcomes = [one for some in found for one in some]
    print("\n".join(table(outcomes, arguments.seed)))
    return int(any(one.wrong for one in outcomes))


if __name__ == "__main__":
    sys.exit(main())
