"""`tentacled stop`: quick stop, then power off. Needs no lease; without a name, all robots stop."""

import argparse
import asyncio
import sys

from daemon.cli import EXIT_USAGE
from daemon.remote.address import Address
from daemon.remote.client import RobotClient
from daemon.remote.client_errors import ClientError
from daemon.remote.command_line import (
    UsageError,
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    addresses,
    failed,
    told,
)
from daemon.remote.messages import Answer


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
        else told(outcome, arguments.json)
        for outcome in outcomes
    ]
    return max(codes)


async def _stop_all(targets: list[Address], within_s: float) -> list[Answer | ClientError]:
    return await asyncio.gather(*(_stop(target, within_s) for target in targets))


async def _stop(target: Address, within_s: float) -> Answer | ClientError:
    try:
        async with await RobotClient.connect(target, own_stop=False) as client:
            return await client.stop(within_s)
    except ClientError as error:
        return error
