"""A limit that is set anew again and again counts from the last time."""

import asyncio

from drivers.aurora.link import TimeLimit
from sim_backends.virtual_time import run_in_virtual_time


class Alarms:
    """A limit, and when it was exceeded, in s."""

    def __init__(self) -> None:
        self.at_s: list[float] = []
        self.limit = TimeLimit(lambda: self.at_s.append(asyncio.get_running_loop().time()))


def test_it_is_exceeded_once_and_on_time() -> None:
    async def scenario() -> list[float]:
        alarms = Alarms()
        alarms.limit.set(0.2)
        await asyncio.sleep(1.0)
        return alarms.at_s

    assert run_in_virtual_time(scenario()) == [0.2]


def test_called_off_in_time_it_is_not_exceeded() -> None:
    async def scenario() -> list[float]:
        alarms = Alarms()
        for _ in range(10):
            alarms.limit.set(0.2)
            await asyncio.sleep(0.1)
            alarms.limit.call_off()
        await asyncio.sleep(1.0)
        return alarms.at_s

    assert run_in_virtual_time(scenario()) == []


def test_it_counts_from_when_it_was_set_last() -> None:
    async def scenario() -> list[float]:
        alarms = Alarms()
        for _ in range(3):
            alarms.limit.set(0.25)
            await asyncio.sleep(0.125)
            alarms.limit.call_off()
        alarms.limit.set(0.25)
        await asyncio.sleep(1.0)
        return alarms.at_s

    assert run_in_virtual_time(scenario()) == [0.625]


def test_a_shorter_one_need_not_wait_for_the_end_of_a_longer_one() -> None:
    async def scenario() -> list[float]:
        alarms = Alarms()
        alarms.limit.set(13.0)
        alarms.limit.call_off()
        await asyncio.sleep(0.5)
        alarms.limit.set(0.25)
        await asyncio.sleep(20.0)
        return alarms.at_s

    assert run_in_virtual_time(scenario()) == [0.75]
