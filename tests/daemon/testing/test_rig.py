"""A rig under test is let go of whatever happens: its lease does not outlive the test."""

from pathlib import Path

import pytest

from daemon.messages import Answer
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.blocking_client import BlockingRobotClient
from daemon.remote.client.client_errors import ClientError, DisconnectedError, TimedOutError
from daemon.testing.rig import RigClient, RigError
from tests import SOFT_ARM

UNCONFIRMED = Answer(request="stop", state="fault", confirmed=False)


class Rig:
    """Stands for the daemon: what it answers, and what is done with it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done: list[str] = []
        self.answers: dict[str, Answer | ClientError] = {}
        monkeypatch.setattr(BlockingRobotClient, "__init__", lambda *_: self.done.append("connect"))
        monkeypatch.setattr(LocalAddress, "in_folder", lambda _folder: "there")
        monkeypatch.setattr(BlockingRobotClient, "connected", True)
        monkeypatch.setattr(BlockingRobotClient, "close", lambda _: self.done.append("close"))
        for name in ("acquire", "stop"):
            monkeypatch.setattr(BlockingRobotClient, name, lambda _, name=name: self._asked(name))

    def _asked(self, name: str) -> Answer:
        self.done.append(name)
        answer = self.answers.get(name, Answer(request=name, state="ready"))
        if isinstance(answer, ClientError):
            raise answer
        return answer


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    return Rig(monkeypatch)


def test_it_is_stopped_and_then_let_go_of(rig: Rig) -> None:
    RigClient(Path(SOFT_ARM), "soft_arm").close()
    assert rig.done == ["connect", "acquire", "stop", "close"]


@pytest.mark.parametrize(
    ("answer", "error"),
    [(TimedOutError("no answer"), TimedOutError), (UNCONFIRMED, RigError)],
)
def test_where_it_does_not_stop_the_lease_runs_out_and_the_test_hears_of_it(
    rig: Rig, answer: Answer | ClientError, error: type[Exception]
) -> None:
    """A client that goes on renewing it would keep the robot moving."""
    client = RigClient(Path(SOFT_ARM), "soft_arm")
    rig.answers["stop"] = answer
    with pytest.raises(error):
        client.close()
    assert rig.done[-2:] == ["stop", "close"]


def test_whoever_does_not_get_the_lease_hangs_up(rig: Rig) -> None:
    rig.answers["acquire"] = DisconnectedError("somebody else has it")
    with pytest.raises(RigError, match="somebody else has it"):
        RigClient(Path(SOFT_ARM), "soft_arm")
    assert rig.done == ["connect", "acquire", "close"]
