"""What is said of every command agrees with what happens when it is asked for."""

from daemon.messages import (
    COMMANDS,
    Acquire,
    Arm,
    Clear,
    Command,
    Hold,
    Load,
    Release,
    Resume,
    Start,
    Verb,
    verb,
)
from safety.states import OperatingState
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig

ASKED: list[type[Command]] = [Arm, Start, Hold, Resume, Clear, Release]


def said(rig: Rig) -> dict[str, Verb]:
    return {told.name: told for told in rig.status.verbs}


async def compare(rig: Rig, kind: type[Command]) -> None:
    """What was said before, and what comes of it."""
    told = said(rig)[verb(kind)]
    if told.possible:
        assert not told.why_not and not told.helps
    else:
        refusal = await rig.refused(kind)
        assert told.why_not and told.helps, told
        assert refusal.name != "no_lease"


def test_every_command_is_spoken_of_in_every_state() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        for kind in ASKED:
            await compare(rig, kind)
        assert said(rig)["arm"].possible and not said(rig)["start"].possible
        await rig.do(Arm)
        assert said(rig)["start"].why_not == "nothing is loaded"
        assert said(rig)["release"].why_not == "the drives are energised"
        for kind in (Arm, Start, Hold, Resume, Clear, Release):
            await compare(rig, kind)
        await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
        assert said(rig)["start"].possible
        await rig.do(Start)
        await rig.until_state(OperatingState.RUNNING)
        assert not said(rig)["load"].possible
        for kind in (Arm, Start, Resume, Clear, Release):
            await compare(rig, kind)
        await rig.do(Hold)
        assert said(rig)["resume"].possible
        assert [told.name for told in rig.status.verbs] == [verb(kind) for kind in COMMANDS]
        free = {told.name for told in rig.status.verbs if not told.needs_lease}
        assert free == {"acquire", "stop"}
        assert said(rig)["stop"].possible and said(rig)["disarm"].possible

    on_a_rig(scene)


def test_what_stands_in_the_way_is_told_with_its_remedy() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        rig.service.supervisor.checks.internal_error(rig.service.clock.now_ns(), "a test")
        await rig.until(lambda: not said(rig)["arm"].possible)
        told = said(rig)["arm"]
        assert told.why_not
        blocking = rig.service.supervisor.blocking
        assert told.helps == blocking[0].cause.remedy

    on_a_rig(scene)


def test_resume_is_told_possible_only_once_what_stopped_the_motion_is_over() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE, MODEL)
        rig.lab.inject("tracker.missing=1s")
        await rig.until_state(OperatingState.HOLD)
        await rig.do(Hold)
        assert said(rig)["resume"].why_not == "what stopped the motion still holds"
        await compare(rig, Resume)
        await rig.until(lambda: said(rig)["resume"].possible)
        await rig.do(Resume)

    on_a_rig(scene)


def test_whoever_takes_a_lost_lease_again_may_resume_at_once() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE, MODEL)
        rig.renewing, rig.token = False, ""
        await rig.until_state(OperatingState.HOLD)
        await rig.do(Acquire)
        await rig.do(Resume)

    on_a_rig(scene)
