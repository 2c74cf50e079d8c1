"""A lease is kept while there is somebody to keep it for, and its loss is told."""

import asyncio
from collections.abc import Awaitable, Callable

from daemon.messages import Answer, Refusal
from daemon.remote.client.client_errors import LeaseLostError, RefusedError, TimedOutError
from daemon.remote.client.lease_keeper import LeaseKeeper
from sim_backends.virtual_time import run_in_virtual_time


class Daemon:
    """Answers renewals as it is told to."""

    def __init__(self) -> None:
        self.asked: list[float] = []
        self.lost: list[LeaseLostError] = []
        self.answers: Callable[[str], Answer] = lambda token: self.granted(token or "t1")

    @staticmethod
    def granted(token: str) -> Answer:
        return Answer(request="", state="", token=token, expires_in_s=2.0)

    async def renew(self, token: str, within_s: float) -> Answer:
        self.asked.append(asyncio.get_running_loop().time())
        return self.answers(token)


def kept(test: Callable[[Daemon, LeaseKeeper], Awaitable[None]]) -> None:
    async def run() -> None:
        daemon = Daemon()
        keeper = LeaseKeeper(daemon.renew, daemon.lost.append)
        await keeper.acquire(1.0)
        await test(daemon, keeper)
        await keeper.stop()

    run_in_virtual_time(run())


def test_a_lease_is_renewed_several_times_before_it_runs_out_and_not_after_stopping() -> None:
    async def test(daemon: Daemon, keeper: LeaseKeeper) -> None:
        await asyncio.sleep(10.0)
        gaps = [b - a for a, b in zip(daemon.asked, daemon.asked[1:], strict=False)]
        assert max(gaps) <= 2.0 / 4
        assert len(gaps) < 60
        assert daemon.lost == []
        assert await keeper.stop() == "t1"
        asked = len(daemon.asked)
        await asyncio.sleep(5.0)
        assert len(daemon.asked) == asked

    kept(test)


def test_a_short_silence_is_survived_and_a_long_one_is_the_loss_of_the_lease() -> None:
    async def test(daemon: Daemon, keeper: LeaseKeeper) -> None:
        granting = daemon.answers

        def silent(token: str) -> Answer:
            raise TimedOutError("no answer")

        await asyncio.sleep(1.0)
        daemon.answers = silent
        await asyncio.sleep(1.0)
        daemon.answers = granting
        await asyncio.sleep(5.0)
        assert daemon.lost == []
        daemon.answers = silent
        await asyncio.sleep(3.0)
        assert [str(error) for error in daemon.lost] == [
            "the lease is lost: it could not be renewed: no answer"
        ]

    kept(test)


def test_a_lease_that_is_taken_again_before_its_loss_is_told_is_kept() -> None:
    async def test(daemon: Daemon, keeper: LeaseKeeper) -> None:
        granting = daemon.answers

        def silent(token: str) -> Answer:
            raise TimedOutError("no answer")

        daemon.answers = silent
        await asyncio.sleep(1.9)
        daemon.answers = lambda token: daemon.granted("t2")
        assert (await keeper.acquire(1.0)).token == "t2"
        daemon.answers = granting
        asked = len(daemon.asked)
        await asyncio.sleep(5.0)
        assert daemon.lost == []
        assert len(daemon.asked) - asked >= 10 and keeper.token == "t2"

    kept(test)


def test_a_renewal_under_way_does_not_undo_what_was_acquired_since() -> None:
    async def run() -> None:
        lost: list[LeaseLostError] = []
        answers: list[asyncio.Future[Answer]] = []

        async def renew(token: str, within_s: float) -> Answer:
            answers.append(asyncio.get_running_loop().create_future())
            return await answers[-1]

        keeper = LeaseKeeper(renew, lost.append)
        first = asyncio.create_task(keeper.acquire(1.0))
        await asyncio.sleep(0.0)
        answers[0].set_result(Daemon.granted("t1"))
        await first
        await asyncio.sleep(0.5)
        second = asyncio.create_task(keeper.acquire(1.0))
        await asyncio.sleep(0.0)
        answers[2].set_result(Daemon.granted("t2"))
        await second
        if not answers[1].done():  # the renewal, with the token before
            refusal = Refusal(request="", state="", name="lease_taken", text="you have it")
            answers[1].set_exception(RefusedError(refusal))
        await asyncio.sleep(0.1)
        assert lost == [] and keeper.token == "t2"
        await keeper.stop()

    run_in_virtual_time(run())


def test_a_lease_that_somebody_else_has_taken_is_lost() -> None:
    async def test(daemon: Daemon, keeper: LeaseKeeper) -> None:
        def refused(token: str) -> Answer:
            raise RefusedError(Refusal(request="", state="", name="no_lease", text="bob has it"))

        daemon.answers = refused
        await asyncio.sleep(3.0)
        assert [str(error) for error in daemon.lost] == ["the lease is lost: bob has it"]

    kept(test)


def test_a_lease_that_ran_out_unnoticed_is_not_used_silently() -> None:
    async def test(daemon: Daemon, keeper: LeaseKeeper) -> None:
        daemon.answers = lambda token: daemon.granted("t2")
        await asyncio.sleep(3.0)
        assert "it ran out before it was renewed" in str(daemon.lost[0])
        assert len(daemon.lost) == 1
        daemon.answers = lambda token: daemon.granted(token)
        assert (await keeper.acquire(1.0)).token == "t2"

    kept(test)
