"""`tentacled lease`: hold the lease in this terminal, so that commands in others may command."""

import argparse
import asyncio
import sys
from pathlib import Path
from typing import Final

from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    address,
    lease_file,
    run_talk,
)
from daemon.host.stop_signals import StopSignals
from daemon.messages import Answer
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, RefusedError
from daemon.remote.client.token_file import StoredLease, forget_lease, store_lease

_LOOK_EVERY_S: Final = 0.1
_TRY_AGAIN_S: Final = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)


def run(arguments: argparse.Namespace) -> Result:
    async def talk(client: RobotClient) -> Result:
        target = address(arguments)
        return await _hold(client, lease_file(target), target.user)

    return run_talk(arguments, talk)


async def _hold(client: RobotClient, path: Path, user: str) -> Result:
    stop = StopSignals()
    stopping = asyncio.create_task(stop.wait(None))
    answer = await client.acquire()
    try:
        store_lease(path, StoredLease(user, answer.token))
        held = {"robot": client.me.robot, "user": user, "lease": "yours"}
        tell("lease", held, f"{client.me.robot}: the lease is yours; Ctrl-C gives it back")
        while not stopping.done():
            if client.lease_lost is not None:
                print(f"{client.lease_lost}; trying to get it back", file=sys.stderr, flush=True)
                taken = await _take_again(client, stopping)
                if taken is None:
                    break
                answer = taken
                store_lease(path, StoredLease(user, answer.token))
                tell("lease", held, "the lease is yours again")
            await asyncio.wait((stopping,), timeout=_LOOK_EVERY_S)
        return await _give_back(client)
    except OSError as error:
        text = f"the lease cannot be kept in {path}: {error.strerror}"
        raise CommandError("input_output", text, place=str(path)) from None
    finally:
        stopping.cancel()
        forget_lease(path, answer.token)


async def _take_again(client: RobotClient, stopping: asyncio.Task[None]) -> Answer | None:
    """The lease, as soon as it can be had; None: told to end."""
    while not stopping.done():
        try:
            return await client.acquire()
        except ClientError:
            await asyncio.wait((stopping,), timeout=_TRY_AGAIN_S)
    return None


async def _give_back(client: RobotClient) -> Result:
    if client.lease_lost is not None:
        raise CommandError("failed", f"{client.lease_lost}")
    try:
        await client.release()
    except RefusedError as error:
        raise CommandError(
            "refused", f"the lease is not given back but runs out: {error}"
        ) from None
    return Result(None)
