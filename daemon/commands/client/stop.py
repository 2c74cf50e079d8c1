"""`tentacled stop`: quick stop, then power off. Needs no lease; without a name, all robots stop.

It goes by STOP's own way, and as an ordinary command only where that brings nothing soon.
"""

import argparse
import asyncio
import sys
from collections.abc import Callable

from daemon.commands.outcome.failures import failure_of
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    add_timeout_argument,
    addresses,
    answer_result,
    tell_text,
)
from daemon.messages import Answer, Stop, verb
from daemon.remote.client.address import Address
from daemon.remote.client.client_errors import ClientError
from daemon.remote.client.stop_client import first_answer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_timeout_argument(parser)


def run(arguments: argparse.Namespace) -> Result:
    targets = addresses(arguments)
    outcomes = asyncio.run(_stop_all(targets, arguments.timeout))
    if len(outcomes) == 1:
        if isinstance(outcome := outcomes[0], ClientError):
            raise outcome
        return answer_result(outcome)
    robots = [
        _one_of_several(target, outcome) for target, outcome in zip(targets, outcomes, strict=True)
    ]
    return Result(
        {"robots": [data for data, _, _ in robots]},
        lambda: tell_text(text for _, text, _ in robots),
        max(code for _, _, code in robots),
    )


def _one_of_several(
    target: Address, outcome: Answer | ClientError
) -> tuple[dict[str, object], str | Callable[[], None], int]:
    """What is told of it to programs and to people, and its exit code."""
    if isinstance(outcome, Answer):
        result = answer_result(outcome)
        return {"robot": target.robot, **(result.data or {})}, result.text, result.code
    failure = failure_of(outcome)
    assert failure is not None
    error: dict[str, object] = {"robot": target.robot, "error": failure.as_json("stop")}
    return error, lambda: print(failure.text, file=sys.stderr), failure.kind.code


async def _stop_all(targets: list[Address], within_s: float) -> list[Answer | ClientError]:
    return await asyncio.gather(*(_stop(target, within_s) for target in targets))


async def _stop(target: Address, within_s: float) -> Answer | ClientError:
    async def as_command(left_s: float) -> Answer:
        # Imported when wanted: STOP's own way needs nothing of it, and is in a hurry.
        from daemon.remote.client.connection import Connection

        connection = await Connection.connect(target)
        try:
            return await connection.command(verb(Stop), Stop(), Answer, left_s)
        finally:
            await connection.close()

    try:
        return await first_answer(target.stop("", within_s), as_command, within_s)
    except ClientError as error:
        return error
