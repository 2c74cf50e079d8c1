"""What a replay is made of: every message at its time, the worst error whatever is thinned out."""

import asyncio
import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import yaml

from daemon.dashboard import replay_pack
from daemon.dashboard.replay_pack import pack
from daemon.messages import Status, Tip
from daemon.recording.result import ErrorTable
from daemon.recording.run_reader import RunMessage, UnreadableRunError
from tests.daemon.recording.synthetic_run import (
    BOOT_NS,
    WALL_NS,
    direct_run,
    make_parts,
    make_run,
    make_surrounded_run,
    messages,
)


class Block:
    """Read as the page reads it."""

    def __init__(self, data: bytes) -> None:
        length = int.from_bytes(data[:4], "little")
        self.header: dict[str, Any] = json.loads(data[4 : 4 + length])
        begins = -(-(4 + length) // 8) * 8
        self.data = data[begins:]

    def numbers(self, place: int, count: int, kind: str) -> "np.ndarray[Any, np.dtype[Any]]":
        assert place % 8 == 0, "a browser looks at it as numbers where it lies"
        return np.frombuffer(self.data, kind, count, place)

    def messages(self, kind: str) -> list[tuple[float, dict[str, Any]]]:
        laid = self.header["kinds"][kind]
        count = laid["count"]
        times = self.numbers(laid["times"], count, "<f8")
        places = self.numbers(laid["places"], count + 1, "<u4")
        payloads = self.data[laid["payloads"] :]
        return [
            (float(t_s), json.loads(payloads[begin:end]))
            for t_s, begin, end in zip(times, places, places[1:], strict=False)
        ]

    def series(self, name: str) -> "tuple[np.ndarray[Any, Any], list[np.ndarray[Any, Any]]]":
        laid = self.header["series"][name]
        times = self.numbers(laid["times"], laid["count"], "<f8")
        return times, [self.numbers(at, laid["count"], "<f4") for at in laid["columns"]]


def block_of(path: Path) -> Block:
    out = io.BytesIO()
    pack(path, out)
    return Block(out.getvalue())


def test_every_message_is_there_as_it_was_recorded_at_its_time(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=2, cycle_s=4.0)
    told = list(messages(cycles=2, cycle_s=4.0))
    tips = [message for message in told if isinstance(message, Tip)]
    block = block_of(tmp_path)
    rows = block.messages("tip")
    assert len(rows) == len(tips) and block.header["kinds"]["tip"]["every"] == 1
    assert [row["sequence"] for _, row in rows] == [tip.sequence for tip in tips]
    assert rows[-1][0] == pytest.approx((tips[-1].t_ns - tips[0].t_ns) * 1e-9, abs=1e-6)
    assert len(block.messages("state")) == len(block.messages("body")) > 0
    assert block.messages("body")[0][1]["centreline_mm"]
    times, (errors,) = block.series("error")
    assert len(times) == len(tips) and np.isnan(errors[0])
    known = [tip.error_mm for tip in tips if tip.error_mm is not None]
    assert np.allclose(errors[np.isfinite(errors)], known)
    assert len(block.series("force")[1]) == 6


def test_the_cycles_and_the_worst_error_are_the_report_s(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=3, cycle_s=4.0)
    table, worst = ErrorTable(), 0.0
    for message in messages(cycles=3, cycle_s=4.0):
        if isinstance(message, Tip):
            table.add(message)
            if message.state == "running" and message.cycle >= 0:
                worst = max(worst, message.error_mm or 0.0)
    header = block_of(tmp_path).header
    assert header["cycles"] == [pytest.approx(msgspec.to_builtins(row)) for row in table.rows()]
    assert header["worst"]["error_mm"] == worst


def test_a_long_recording_is_thinned_out_and_its_worst_moment_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_run(tmp_path, cycles=3, cycle_s=6.0)
    whole = block_of(tmp_path)
    monkeypatch.setattr(replay_pack, "MOST_KEPT", 64)
    thin = block_of(tmp_path)
    rows, every = thin.messages("tip"), thin.header["kinds"]["tip"]["every"]
    assert len(rows) <= 65 and every >= 8
    gaps = np.diff([t_s for t_s, _ in rows])
    assert gaps.max() < 1.1 * every / 40.0, "evenly: no stretch is without a frame"
    assert thin.header["worst"] == whole.header["worst"]
    assert any(row.get("error_mm") == whole.header["worst"]["error_mm"] for _, row in rows)
    assert thin.header["duration_s"] == whole.header["duration_s"]
    assert thin.header["cycles"] == whole.header["cycles"], "counted before anything is left out"


def test_events_and_states_are_in_step(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=2, cycle_s=6.0)
    header = block_of(tmp_path).header
    events = [(event["t_s"], event["name"]) for event in header["events"]]
    assert [name for _, name in events] == ["running", "hold", "running", "armed"]
    assert [state for _, state in header["states"]] == [
        "armed",
        "running",
        "hold",
        "running",
        "armed",
    ]
    for (t_s, name), (entered_s, state) in zip(events, header["states"][1:], strict=True):
        assert name == state and abs(t_s - entered_s) < 0.03


def test_a_run_in_parts_tells_what_nobody_recorded(tmp_path: Path) -> None:
    make_parts(tmp_path, slice(300, 420))
    header = block_of(tmp_path).header
    ((begins_s, ends_s),) = header["gaps"]
    assert 0.5 < ends_s - begins_s < 5.0


def test_a_recording_that_goes_on_is_replayed_as_far_as_it_is(tmp_path: Path) -> None:
    run = make_run(tmp_path, cycles=1, cycle_s=60.0)
    whole = run.read_bytes()
    run.unlink()
    (tmp_path / "run.mcap.part").write_bytes(whole[: len(whole) // 2])
    header = block_of(tmp_path).header
    assert header["duration_s"] > 0.0 and not header["whole"]


def test_the_workspace_is_the_run_s_own(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=2.0)
    assert block_of(tmp_path).header["workspace_mm"] is None
    box = {"x_mm": [-1, 1], "y_mm": [-2, 2], "z_mm": [0, 3]}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump({"workspace": box}))
    assert block_of(tmp_path).header["workspace_mm"] == [[-1, 1], [-2, 2], [0, 3]]
    (tmp_path / "robot.yaml").write_bytes(b"\xff: [")
    assert block_of(tmp_path).header["workspace_mm"] is None


def test_surroundings_are_those_of_each_moment(tmp_path: Path) -> None:
    changed = make_surrounded_run(tmp_path, cycle_s=4.0)
    told = block_of(tmp_path).header["surroundings"]
    assert [one["mesh"] for one in told] == ["room.stl", "other.stl", "lost.stl"]
    assert [one["t_s"] for one in told] == pytest.approx([0.0, 2.0, 3.0])
    assert [one["file"] for one in told] == ["surroundings.stl", "surroundings-2.stl", ""]
    assert [one["lost"] for one in told] == [False, False, True]
    assert [len(one["regions"]) for one in told] == [0, 1, 0]
    assert told[1]["regions"][0]["kind"] == "ball" and len(changed) == 3


def test_a_recording_that_tells_of_no_surroundings_has_its_folder_s(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=2.0)
    (none,) = block_of(tmp_path).header["surroundings"]
    assert (none["file"], none["regions"]) == ("", [])
    ball = {"kind": "ball", "centre_mm": [0.0, 0.0, 9.0], "radius_mm": 3.0}
    regions = [ball, {"kind": "blob"}, 7]
    (tmp_path / "robot.yaml").write_text(
        yaml.safe_dump({"risk": {"surface": {"regions": regions}}})
    )
    (tmp_path / "surroundings.stl").write_bytes(bytes(84))
    (told,) = block_of(tmp_path).header["surroundings"]
    assert (told["t_s"], told["file"], told["lost"]) == (0.0, "surroundings.stl", False)
    assert [one["kind"] for one in told["regions"]] == ["ball"], "what is none is not drawn"


def test_a_recording_that_was_cut_off_before_its_first_step_is_replayed(tmp_path: Path) -> None:
    state = next(one for one in messages() if isinstance(one, Status))
    asyncio.run(direct_run(tmp_path, [state, msgspec.structs.replace(state, t_ns=BOOT_NS + 7)]))
    block = block_of(tmp_path)
    assert [told["robot"] for _, told in block.messages("state")] == ["soft_arm", "soft_arm"]
    times, columns = block.series("reference")
    assert len(times) == 0 and [len(column) for column in columns] == [0, 0, 0]


def test_messages_that_are_none_are_left_out_and_counted(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=2.0)
    packer = replay_pack.ReplayPacker(tmp_path)
    for topic in ("/state", "/body", "/tip", "/surroundings_changed"):
        for data in (b'{"of": "another version"}', b"\xff"):
            packer.take(RunMessage(topic, WALL_NS, 0, data))
    assert packer.unreadable == 8 and packer.empty
    assert block_of(tmp_path).header["unreadable"] == 0


def test_what_is_no_recording_is_said_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no recording")
    with pytest.raises(UnreadableRunError):
        pack(tmp_path, io.BytesIO())
    done = subprocess.run(
        [sys.executable, "-m", "daemon.dashboard.replay_pack", str(tmp_path)],
        capture_output=True,
        check=False,
    )
    assert done.returncode == replay_pack.EXIT_UNREADABLE and done.stdout == b""
    assert done.stderr.count(b"\n") == 1 and b"Traceback" not in done.stderr
