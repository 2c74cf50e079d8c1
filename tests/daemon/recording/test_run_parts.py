"""A run is all of its recordings, in order, also those begun after a recorder was lost."""

import asyncio
from pathlib import Path

import msgspec
import pytest

from daemon.messages import Tip
from daemon.recording.format.channels import TOPICS
from daemon.recording.recovery import recover_unfinished
from daemon.recording.run_folder import segment_file, unfinished
from daemon.recording.run_parts import RunParts, control_hash, run_files, segment_number
from daemon.recording.run_reader import UnreadableRunError
from tests.daemon.recording.synthetic_run import direct_run, make_parts, messages

GAP = slice(600, 700)


def tips(path: Path) -> list[int]:
    """Their numbers, in the order of reading."""
    found = RunParts(path).messages([TOPICS[Tip]])
    return [msgspec.json.decode(message.data, type=Tip).sequence for message in found]


@pytest.mark.parametrize("recovered", [False, True])
def test_all_recordings_of_a_run_are_read_in_order(recovered: bool, tmp_path: Path) -> None:
    recorded = make_parts(tmp_path, GAP)
    if recovered:
        assert all(outcome.complete for outcome in recover_unfinished(tmp_path))
    assert tips(tmp_path) == [each.sequence for each in recorded if isinstance(each, Tip)]


def test_the_tenth_recording_comes_after_the_ninth(tmp_path: Path) -> None:
    telemetry = list(messages(1, 1.0))
    each = len(telemetry) // 11
    for number in range(1, 12):
        some = telemetry[(number - 1) * each : number * each]
        asyncio.run(direct_run(tmp_path, some, segment_file(number)))
    for odd in ("run-1.mcap", "run-02.mcap", "run-x.mcap", "runs.mcap", "run.mcap.damaged"):
        (tmp_path / odd).write_bytes(b"something else")
    assert [path.name for path in run_files(tmp_path)] == [segment_file(k) for k in range(1, 12)]
    found = tips(tmp_path)
    assert found == sorted(found)
    assert len(found) == sum(isinstance(one, Tip) for one in telemetry[: 11 * each])


def test_of_a_recording_that_is_there_twice_the_finished_one_counts(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    unfinished(path).touch()
    assert run_files(tmp_path) == [unfinished(path)]
    path.touch()
    assert run_files(tmp_path) == [path]
    assert run_files(unfinished(path)) == [unfinished(path)], "that was asked for by name"
    assert segment_number(unfinished(path)) == segment_number(path) == 1


def test_one_recording_that_is_none_hides_no_other(tmp_path: Path) -> None:
    recorded = make_parts(tmp_path, GAP)
    unfinished(tmp_path / "run.mcap").write_bytes(b"this is no recording at all")
    parts = RunParts(tmp_path)
    assert sum(1 for _ in parts.messages([TOPICS[Tip]])) == sum(
        isinstance(each, Tip) for each in recorded[GAP.start :]
    )
    assert parts.unreadable == 1
    assert not parts.whole
    (tmp_path / segment_file(2)).write_bytes(b"nor this")
    with pytest.raises(UnreadableRunError, match=r"run\.mcap\.part is not a recording"):
        list(RunParts(tmp_path).messages())


def test_another_pass_goes_on_in_the_recording_that_was_begun_meanwhile(tmp_path: Path) -> None:
    telemetry = list(messages(1, 1.0))
    half = len(telemetry) // 2
    parts = RunParts(tmp_path)
    with pytest.raises(UnreadableRunError, match=r"there is no run\.mcap"):
        next(parts.messages())
    seen = []
    for number, some in ((1, telemetry[:half]), (2, telemetry[half:])):
        asyncio.run(direct_run(tmp_path, some, segment_file(number)))
        seen += list(parts.messages())
    assert seen == list(RunParts(tmp_path).messages())
    assert parts.whole
    assert [(a.path.name, b.path.name) for a, b in parts.gaps] == [("run.mcap", "run-2.mcap")]


def test_the_fingerprint_is_the_same_however_a_run_was_cut(tmp_path: Path) -> None:
    telemetry = list(messages(1, 1.0))
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    for folder in (whole, cut):
        folder.mkdir()
    asyncio.run(direct_run(whole, telemetry))
    asyncio.run(direct_run(cut, telemetry[:100]))
    asyncio.run(direct_run(cut, telemetry[100:], segment_file(2)))
    assert control_hash(whole, ["/tip", "/axes"]) == control_hash(cut, ["/tip", "/axes"])
    assert control_hash(cut) != control_hash(cut / "run.mcap")
