"""What zenoh's threads hand to the loop: bounded, in the right order, and never lost."""

import asyncio
import threading

from daemon.host.clock import run_in_real_time
from daemon.remote.server.inbox import Inbox, Quota
from tests.daemon.remote.rig import until

USERS = ("alice", "bob")


class Taken:
    """What came out of an inbox, in its order."""

    def __init__(self) -> None:
        self.all: list[str] = []

    def question(self, question: str) -> None:
        self.all.append(question)

    def setpoint(self, asker: str, payload: bytes, encoding: str) -> None:
        self.all.append(f"{asker} {payload.decode()}")


def opened() -> tuple[Inbox[str], Taken]:
    inbox, taken = Inbox[str](USERS), Taken()
    inbox.open(taken.question, taken.setpoint)
    return inbox, taken


def test_a_stop_comes_before_everything_that_waited_longer() -> None:
    async def test() -> None:
        inbox, taken = opened()
        for number in range(5):
            assert inbox.question("alice", f"question {number}")
        inbox.setpoint("alice", b"set-point", "")
        assert inbox.stop("bob", "STOP")
        await until(lambda: len(taken.all) == 7)
        assert taken.all[:3] == ["STOP", "alice set-point", "question 0"]

    run_in_real_time(test())


def test_a_stop_waits_for_one_question_at_most() -> None:
    async def test() -> None:
        inbox, taken = Inbox[str](USERS), Taken()

        def question(text: str) -> None:
            taken.question(text)
            if text == "question 0":
                inbox.stop("bob", "STOP")

        inbox.open(question, taken.setpoint)
        for number in range(10):
            inbox.question("alice", f"question {number}")
        await until(lambda: len(taken.all) == 11)
        assert taken.all[:3] == ["question 0", "STOP", "question 1"]

    run_in_real_time(test())


def test_nobody_waits_for_all_questions_of_another() -> None:
    async def test() -> None:
        inbox, taken = opened()
        for number in range(10):
            inbox.question("alice", f"alice {number}")
        inbox.question("bob", "bob")
        await until(lambda: len(taken.all) == 11)
        assert taken.all.index("bob") <= 1

    run_in_real_time(test())


def test_the_loop_gets_round_to_its_other_work_between_two_questions() -> None:
    async def test() -> None:
        inbox, taken = opened()
        for number in range(10):
            inbox.question("alice", f"question {number}")
        most, before = 0, 0
        while len(taken.all) < 10:
            await asyncio.sleep(0)
            most, before = max(most, len(taken.all) - before), len(taken.all)
        assert most == 1

    run_in_real_time(test())


def test_of_the_set_points_that_wait_only_the_newest_counts() -> None:
    async def test() -> None:
        inbox, taken = opened()
        for number in range(100):
            inbox.setpoint("alice", str(number).encode(), "")
        inbox.setpoint("bob", b"7", "")
        await until(lambda: len(taken.all) == 2)
        assert sorted(taken.all) == ["alice 99", "bob 7"]

    run_in_real_time(test())


def test_there_is_room_for_so_many_and_each_has_his_own() -> None:
    async def test() -> None:
        inbox, taken = opened()
        fitted = sum(inbox.question("alice", "question") for _ in range(1000))
        assert 4 <= fitted <= 64
        assert not inbox.question("alice", "question")
        assert inbox.question("bob", "question")
        assert inbox.stop("alice", "STOP")
        await until(lambda: len(taken.all) == fitted + 2)
        assert inbox.question("alice", "question")

    run_in_real_time(test())


def test_nothing_is_lost_between_threads() -> None:
    async def test() -> None:
        inbox, taken = opened()
        refused: list[str] = []

        def leave(user: str) -> None:
            for number in range(500):
                while not inbox.question(user, f"{user} {number}"):
                    refused.append(user)
                    threading.Event().wait(0.001)

        threads = [threading.Thread(target=leave, args=(user,)) for user in USERS]
        for thread in threads:
            thread.start()
        await until(lambda: len(taken.all) == 1000)
        for user in USERS:
            mine = [question for question in taken.all if question.startswith(user)]
            assert mine == [f"{user} {number}" for number in range(500)]
        for thread in threads:
            thread.join()

    run_in_real_time(test())


def test_closing_gives_back_what_waits_and_takes_nothing_more() -> None:
    async def test() -> None:
        inbox, taken = opened()
        inbox.question("alice", "question")
        inbox.stop("alice", "STOP")
        assert sorted(inbox.close()) == ["STOP", "question"]
        assert not inbox.question("alice", "late")
        inbox.setpoint("alice", b"late", "")
        await asyncio.sleep(0.01)
        assert taken.all == []

    run_in_real_time(test())


def test_a_loop_that_has_ended_does_not_hurt_who_leaves_something() -> None:
    async def test() -> Inbox[str]:
        return opened()[0]

    inbox = run_in_real_time(test())
    inbox.setpoint("alice", b"set-point", "")
    assert not inbox.question("alice", "question")
    assert not inbox.stop("alice", "STOP")


def test_a_quota_is_so_many_a_second_and_those_of_one_second_at_once() -> None:
    class Still:
        """Time goes on when it is told to."""

        t_ns = 0

        def now_ns(self) -> int:
            return self.t_ns

    clock = Still()
    quota = Quota(100, clock)
    assert [quota.take() for _ in range(101)] == [True] * 100 + [False]
    clock.t_ns += 50_000_000
    assert [quota.take() for _ in range(6)] == [True] * 5 + [False]
    clock.t_ns += 3_600_000_000_000
    assert sum(quota.take() for _ in range(200)) == 100
