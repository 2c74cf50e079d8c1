"""`tentacled bridge ros2` as a process, heard by an independent SDK in another."""

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.daemon.bridges.test_openigtlink_bridge import fake_daemon
from tests.daemon.remote.conftest import tmp_path as tmp_path
from tests.hil.processes import Process, command, run

pytest.importorskip("rosbags", reason="pip install '.[bridges]'")

POSE = "geometry_msgs/msg/PoseStamped"
TOPICS = {
    "/little_arm/tip": POSE,
    "/tf": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])


def heard(witness: Process, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    while True:
        told: dict[str, Any] = json.loads(witness.next_line()[1])
        if wanted(told):
            return told


def test_an_independent_sdk_hears_tip_and_causes_and_sees_the_node(tmp_path: Path) -> None:
    pytest.importorskip("zenoh_ros2_sdk", reason="pip install '.[test]'")
    port = free_port()
    words = ["bridge", "ros2", "little_arm", "--runtime-dir", str(tmp_path / "run")]
    router = ["--be-router", "--router", f"tcp/127.0.0.1:{port}", "--domain", "0"]
    bridge = Process(command(*words, *router), stderr=subprocess.STDOUT)
    witness = None
    try:
        assert bridge.next_line()[1].startswith("ROS domain 0, router at tcp/127.0.0.1:")
        with fake_daemon(tmp_path / "run"):
            module = "tests.daemon.bridges.ros2.witness_ros2"
            asked = [f"{topic}={kind}" for topic, kind in TOPICS.items()]
            witness = Process(
                [sys.executable, "-m", module, str(port), str(tmp_path / "msg"), *asked],
                stdin=subprocess.PIPE,
            )
            mine = "/NN/%/%/tentacled_little_arm"  # beside those of the witness itself
            heard(witness, lambda told: told.get("token", "").endswith(mine))
            tip = heard(witness, lambda told: told.get("topic") == "/little_arm/tip")["message"]
            assert tip["header"]["frame_id"] == "little_arm/base"
            place = tip["pose"]["position"]
            assert [place[axis] for axis in "xyz"] == pytest.approx([0.0011, 0.0021, 0.1034])
            assert tip["pose"]["orientation"]["w"] == 1.0
            moved = heard(witness, lambda told: told.get("topic") == "/tf")["message"]["transforms"]
            assert [one["child_frame_id"] for one in moved] == [
                "little_arm/tip",
                "little_arm/reference",
            ]
        gone = heard(witness, lambda told: told.get("topic") == "/diagnostics")["message"]
        while "not connected" not in gone["status"][0]["message"]:
            gone = heard(witness, lambda told: told.get("topic") == "/diagnostics")["message"]
        assert gone["status"][0]["level"] == 3
        assert bridge.end() == 0
    finally:
        bridge.leave()
        if witness is not None:
            witness.leave()
            assert witness.process.stdin is not None
            witness.process.stdin.close()


def test_what_cannot_be_is_told_at_once() -> None:
    told = run("bridge", "ros2", "little_arm", "--domain", "4000")
    assert told.returncode == 64 and "a ROS domain is 0 to 232" in told.stderr
    told = run("bridge", "ros2", "little_arm", "--router", "no such endpoint")
    assert told.returncode == 64 and "no such endpoint" in told.stderr
