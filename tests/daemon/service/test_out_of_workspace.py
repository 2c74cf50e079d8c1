"""Who is drawn out of the workspace is held there, led back when the operator resumes, and held
again where it goes farther out: in virtual time, by the emulated arm."""

import asyncio

from config.control import Workspace
from config.robot import Robot
from daemon.messages import Load, Resume, Start
from safety.causes import Severity, cause
from safety.states import OperatingState
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig

S = OperatingState
OUT = "out_of_workspace"


def in_a_narrow_box(robot: Robot) -> Robot:
    """A little wider than the circle of 10 mm at a height of 190 mm that is followed."""
    box = Workspace(x_mm=(-14.0, 14.0), y_mm=(-14.0, 14.0), z_mm=(178.0, 202.0))
    return robot.model_copy(update={"workspace": box})


async def inside(rig: Rig) -> None:
    """At rest the arm is longer than its workspace is high: it is led in, without a hold."""
    await rig.armed()
    assert rig.service.loop.outside_mm > 3.0
    await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
    await rig.do(Start)
    await rig.until(lambda: rig.service.loop.outside_mm < 0.0, within_s=5.0)
    await asyncio.sleep(3.0)
    assert rig.in_state(S.RUNNING) and not rig.events("cause", OUT)


async def drawn_out(rig: Rig, mass_g: float) -> float:
    """Hang a weight on the tip; how far outside it is when it has come to rest."""
    rig.lab.set_tip_load(mass_g)
    await rig.until_state(S.HOLD, within_s=5.0)
    await asyncio.sleep(1.0)
    assert rig.service.supervisor.severity is Severity.HOLD
    return rig.service.loop.outside_mm


def test_a_tip_that_was_drawn_out_is_led_back_when_the_operator_resumes() -> None:
    """The weight stays on it: nobody has to home the axes, or to move them by hand."""

    async def scene(rig: Rig) -> None:
        await inside(rig)
        outside_mm = await drawn_out(rig, 45.0)
        assert outside_mm > 3.0
        (why,) = (one for one in rig.status.reasons if one.name == OUT)
        assert why.remedy == cause(OUT).remedy
        await rig.do(Resume)
        farthest_mm = 0.0
        while rig.service.loop.outside_mm > 0.0:
            farthest_mm = max(farthest_mm, rig.service.loop.outside_mm)
            await asyncio.sleep(0.025)
            assert rig.in_state(S.RUNNING)
        assert farthest_mm < outside_mm + 2.0
        await asyncio.sleep(5.0)
        assert rig.in_state(S.RUNNING) and OUT not in rig.causes
        assert rig.service.loop.error_mm is not None and rig.service.loop.error_mm < 3.0

    on_a_rig(scene, change=in_a_narrow_box)


def test_who_is_led_back_may_not_go_farther_out() -> None:
    async def scene(rig: Rig) -> None:
        await inside(rig)
        await drawn_out(rig, 40.0)
        await rig.do(Resume)
        await rig.until_state(S.RUNNING)
        await drawn_out(rig, 52.0)
        assert len(rig.events("cause", OUT)) == 2

    on_a_rig(scene, change=in_a_narrow_box)


def test_while_it_stands_it_is_not_held_wherever_it_is_drawn() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        rig.lab.set_tip_load(60.0)
        await asyncio.sleep(2.0)
        assert rig.service.loop.outside_mm > 3.0
        assert rig.in_state(S.ARMED) and OUT not in rig.causes

    on_a_rig(scene, change=in_a_narrow_box)
