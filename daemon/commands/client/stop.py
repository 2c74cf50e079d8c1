"""`tentacled stop`: quick stop, then power off. Needs no lease; without a name, all robots stop.

It goes by STOP's own way, and as an ordinary command only where that brings nothing soon.
"""

import argparse
import asyncio
import sys

from daemon.commands.terminal.command_line import EXIT_USAGE
from daemon.commands.terminal.remote_arguments import (
    UsageError,
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    addresses,
    failed,
    print_answer,
)
from daemon.messages import Answer, Stop, verb
from daemon.remote.client.address import Address
from daemon.remote.client.client_errors import ClientError
from daemon.remote.client.stop_client import first_answer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_json_argument(parser)
    add_timeout_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    try:
        targets = addresses(arguments)
    except UsageError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    except ClientError as error:
        return failed(error, arguments.json)
    outcomes = asyncio.run(_stop_all(targets, arguments.timeout))
    codes = [
        failed(outcome, arguments.json)
        if isinstance(outcome, ClientError)
        else print_answer(outcome, arguments.json)
        for outcome in outcomes
    ]
    return max(codes)


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
