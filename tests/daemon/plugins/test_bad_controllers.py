"""A controller of a package does everything wrong: it is refused, or the robot holds, by name."""

import asyncio
from dataclasses import dataclass
from pathlib import Path

import pytest

from daemon.control import guarded_controller
from daemon.messages import Acquire, Load
from safety.causes import Cause
from safety.states import OperatingState
from tests.daemon.plugins.packages import NOTHING, OPTIONS, controller_package
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig
from tests.installed_package import installed

WHOSE = "the controller 'mine' of other_people 1.2"
MINE = {"kind": "mine"}


@dataclass(frozen=True)
class Refused:
    """What cannot be loaded."""

    told: str
    options: str = OPTIONS
    make: str = "pass"
    maker: str | None = None
    asked: tuple[tuple[str, object], ...] = ()


REFUSED = {
    "options cannot be imported": Refused(
        f"{WHOSE} cannot be imported: ModuleNotFoundError: No module named 'nowhere'",
        options="import nowhere",
    ),
    "controller cannot be imported": Refused(
        f"{WHOSE} cannot be imported: ZeroDivisionError: division by zero", maker="1 / 0"
    ),
    "another API version": Refused(
        f"{WHOSE} is written for API version 9, and this is version 1",
        options=OPTIONS.replace(':make")', ':make", api=9)'),
    ),
    "no kind": Refused(f"{WHOSE}: other_people.kinds:MINE is no Kind", options="MINE = 3"),
    "options of another name": Refused(
        f"{WHOSE}: its options need a field kind: Literal['mine']",
        options=OPTIONS.replace('Literal["mine"]', 'Literal["yours"]'),
    ),
    "options that it does not have": Refused(
        "controller.gian: unknown key (did you mean 'gain'?)", asked=(("gian", 2.0),)
    ),
    "options of the wrong type": Refused(
        "controller.gain: should be a valid number, not 'much'", asked=(("gain", "much"),)
    ),
    "cannot be made": Refused(
        f"{WHOSE} cannot be made: KeyError: 'proximal'", make='raise KeyError("proximal")'
    ),
    "does not want this robot": Refused(
        f"{WHOSE}: six axes are too many", make='raise ControllerError("six axes are too many")'
    ),
    "is no controller": Refused(
        f"{WHOSE} is no Controller: it has no reset, observe, propose, learn, save, load",
        make="return object()",
    ),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=list(REFUSED))
def test_what_cannot_be_used_is_refused_by_name(case: Refused, tmp_path: Path) -> None:
    package = controller_package(tmp_path, options=case.options, make=case.make, maker=case.maker)

    async def story(rig: Rig) -> None:
        await rig.do(Acquire)
        controller = {**MINE, **dict(case.asked)}
        refusal = await rig.refused(Load, trajectory=SMALL_CIRCLE, controller=controller)
        assert refusal.name == "bad_controller"
        assert case.told in refusal.text

    with installed(package):
        on_a_rig(story)


HELD = {
    "wrong shape": (
        "return Proposal(np.zeros(5))",
        "proposed a step of shape (5,), and there are 6 axes",
    ),
    "not a number": (
        "return Proposal(np.full(self.axes, np.nan))",
        "proposed what is not a number",
    ),
    "no proposal": ("return 'left'", "proposed no Proposal, but 'left'"),
    "nothing": ("pass", "proposed no Proposal, but None"),
    "words": ("return Proposal(['a'] * 6)", "proposed no step: ValueError: "),
    "an array that does not come off its device": (
        "return Proposal(type('Tensor', (), {'__array__': lambda *_, **__: 1 / 0})())",
        "failed in propose: ZeroDivisionError: ",
    ),
    "a note that cannot be printed": (
        "return Proposal(np.zeros(6), type('Note', (), {'__str__': lambda _: 1 / 0})())",
        "failed in propose: ZeroDivisionError: ",
    ),
    "raises": ("raise IndexError('five')", "failed in propose: IndexError: five"),
    "gives up": ("raise ControllerError('lost')", ": lost"),
    "ends the process": ("sys.exit(3)", "SystemExit: 3"),
    "recurs": ("return self.propose(observation)", "failed in propose: RecursionError: "),
}


async def _holds(rig: Rig, told: str) -> None:
    """Standing still, energised, with the reason; and every frame makes a step as before."""
    await rig.until_state(OperatingState.HOLD, within_s=20.0)
    reasons = rig.service.supervisor.stopped_by
    assert [one.cause for one in reasons][:1] == [Cause.CONTROLLER_FAILED]
    assert WHOSE in reasons[0].detail
    assert told in reasons[0].detail
    steps = rig.service.loop.steps
    await asyncio.sleep(0.5)
    assert rig.state is OperatingState.HOLD
    assert rig.service.loop.steps >= steps + 19


@pytest.mark.parametrize(("propose", "told"), HELD.values(), ids=list(HELD))
@pytest.mark.parametrize("answering", ["at_once", "in_a_thread"])
def test_a_step_that_is_none_holds_the_robot(
    propose: str, told: str, answering: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread is given real time enough to answer, however busy the machine is."""
    monkeypatch.setattr(guarded_controller, "ANSWER_WITHIN_S", 10.0)
    late = f"if self.asked > 20:\n    {propose}\nelse:\n    return Proposal(np.zeros(self.axes))"

    async def story(rig: Rig) -> None:
        rig.operator.loading.loader._answering = getattr(guarded_controller, answering)
        await rig.running(controller=MINE)
        await _holds(rig, told)

    with installed(controller_package(tmp_path, late)):
        on_a_rig(story)


def test_what_it_learns_in_spare_time_cannot_end_the_loop(tmp_path: Path) -> None:
    async def story(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MINE)
        rig.operator.start(5.0)
        await _holds(rig, "failed in learn: ValueError: singular")

    with installed(controller_package(tmp_path, learn="raise ValueError('singular')")):
        on_a_rig(story)


_SLEEP = "time.sleep(1.0 if self.asked > 20 else 0.0)"
SLOW = {"propose": (f"{_SLEEP}\n{NOTHING}", "pass"), "learn": (NOTHING, _SLEEP)}


@pytest.mark.parametrize("what", ["propose", "learn"])
def test_one_that_sleeps_holds_the_robot_and_not_the_loop(what: str, tmp_path: Path) -> None:
    """Virtual time passes meanwhile, so it is late by the clock of the thread that waits."""

    async def story(rig: Rig) -> None:
        rig.operator.loading.loader._answering = guarded_controller.in_a_thread
        await rig.running(controller=MINE)
        await _holds(rig, "gave no answer within 6 ms: ")

    propose, learn = SLOW[what]
    with installed(controller_package(tmp_path, propose, learn)):
        on_a_rig(story)


def test_a_good_one_runs_beside_ours(tmp_path: Path) -> None:
    async def story(rig: Rig) -> None:
        await rig.running(controller=MINE)
        await asyncio.sleep(1.0)
        assert rig.state is OperatingState.RUNNING
        status = rig.service.status().reference
        assert status is not None
        assert status.controller == "mine"

    with installed(controller_package(tmp_path)):
        on_a_rig(story)


def test_nothing_is_imported_that_nobody_has_installed(tmp_path: Path) -> None:
    """A name is looked for in a list, and is never a path."""
    touched = tmp_path / "touched"
    (tmp_path / "evil.py").write_text(f"open({str(touched)!r}, 'w')\nKIND = 1\n")

    async def story(rig: Rig) -> None:
        await rig.do(Acquire)
        for name in ("evil:KIND", "evil", "config.tasks.controllers:BROYDEN", "../evil"):
            refusal = await rig.refused(Load, trajectory=SMALL_CIRCLE, controller={"kind": name})
            assert "must be one of 'broyden', 'constant_curvature'" in refusal.text

    with installed(tmp_path):
        on_a_rig(story)
    assert not touched.exists()
