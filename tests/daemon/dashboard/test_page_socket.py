"""The buttons of the page say what the daemon says, and who may press them."""

import msgspec
import pytest

from daemon.dashboard.page_socket import buttons
from daemon.messages import COMMANDS, Status, Verb, verb
from tests.daemon.remote.rig import FakeRobot


def status(**impossible: str) -> Status:
    verbs = [
        Verb(
            name=verb(kind),
            needs_lease=True,
            possible=verb(kind) not in impossible,
            why_not=impossible.get(verb(kind), ""),
            helps="Do something" if verb(kind) in impossible else "",
        )
        for kind in COMMANDS
    ]
    return msgspec.structs.replace(FakeRobot().status(), verbs=verbs)


def test_what_the_daemon_would_refuse_is_not_offered_and_says_what_helps() -> None:
    drawn = {b["verb"]: b for b in buttons(status(start="nothing is loaded"), "operator", True)}
    assert drawn["arm"]["enabled"] and drawn["arm"]["hold_s"] > 0.5, "what makes it strong is held"
    assert not drawn["start"]["enabled"]
    assert (drawn["start"]["why"], drawn["start"]["helps"]) == ("nothing is loaded", "Do something")


def test_what_is_refused_without_a_reason_is_not_offered_either() -> None:
    drawn = {b["verb"]: b for b in buttons(status(start=""), "operator", True)}
    assert not drawn["start"]["enabled"] and drawn["start"]["why"]


@pytest.mark.parametrize(
    ("role", "in_control", "why"),
    [
        ("viewer", False, "viewers only watch"),
        ("viewer", True, "viewers only watch"),
        (None, True, "viewers only watch"),
        ("operator", False, "alice is in control"),
    ],
)
def test_who_is_not_in_control_is_offered_nothing(
    role: str | None, in_control: bool, why: str
) -> None:
    drawn = buttons(status(), role, in_control, "alice")
    assert drawn and all(not b["enabled"] and b["why"] == why and b["helps"] for b in drawn)


def test_a_daemon_that_does_not_speak_of_a_command_is_not_asked_for_it() -> None:
    older = msgspec.structs.replace(FakeRobot().status(), verbs=[])
    assert not any(b["enabled"] for b in buttons(older, "operator", True))
