"""`tentacled bridge foxglove` as a process, heard over its WebSocket protocol."""

import asyncio
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.daemon.bridges.test_openigtlink_bridge import fake_daemon
from tests.daemon.remote.conftest import tmp_path as tmp_path
from tests.hil.processes import PATIENCE_S, Process, command, run

pytest.importorskip("foxglove", reason="pip install '.[bridges]'")
PROTOCOL = "foxglove.sdk.v1"


async def heard(port: int) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What is said of the server, and a message of /tip and one of /tf."""
    told: dict[str, bytes] = {}
    about: dict[str, Any] = {}
    topics: dict[int, str] = {}
    async with (
        asyncio.timeout(PATIENCE_S),
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{port}", protocols=[PROTOCOL]) as socket,
    ):
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                said = json.loads(message.data)
                if said["op"] == "serverInfo":
                    about = said
                elif said["op"] == "advertise":
                    wanted = [c for c in said["channels"] if c["topic"] in ("/tip", "/tf")]
                    topics |= {c["id"]: c["topic"] for c in wanted}
                    ids = [{"id": c["id"], "channelId": c["id"]} for c in wanted]
                    await socket.send_json({"op": "subscribe", "subscriptions": ids})
            elif message.type is aiohttp.WSMsgType.BINARY and message.data[0] == 1:
                (number,) = struct.unpack_from("<I", message.data, 1)
                told[topics[number]] = message.data[13:]
                if len(told) == 2:
                    break
    return about, told


def test_a_viewer_hears_the_tip_and_can_do_nothing(tmp_path: Path) -> None:
    with fake_daemon(tmp_path):
        bridge = Process(
            command("bridge", "foxglove", "--runtime-dir", str(tmp_path), "--port", "0"),
            stderr=subprocess.STDOUT,
        )
        try:
            line = bridge.next_line()[1]
            assert line.startswith("Foxglove at ws://127.0.0.1:"), line
            about, told = asyncio.run(heard(int(line.split(":")[2].split(";")[0])))
            assert json.loads(told["/tip"])["tip_mm"] == [1.1, 2.1, 103.4]
            assert b"base" in told["/tf"]
            assert about["capabilities"] == [] and about["name"] == "tentacled"
            assert bridge.end() == 0
        finally:
            bridge.leave()


def test_without_the_library_it_is_told_how_to_install_it() -> None:
    code = (
        "import sys; sys.modules['foxglove'] = None\n"
        "import importlib.util as util; found = util.find_spec\n"
        "import daemon.commands.bridge.bridge_process as process\n"
        "process.find_spec = lambda name: None if name == 'foxglove' else found(name)\n"
        "from daemon.commands.terminal.command_line import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    for words in (("bridge", "foxglove", "--port", "0"), ("export", "x", "--foxglove", "y.mcap")):
        told = subprocess.run(
            [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False
        )
        assert told.returncode == 69, told
        assert "pip install 'tentacled[bridges]'" in told.stderr
    assert run("bridge", "openigtlink", "--help").returncode == 0
