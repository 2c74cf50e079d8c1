"""An unfinished recording is made whole: whatever was complete is kept, and nothing ever raises."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from daemon.commands.outcome.exit_codes import EXIT_OK
from daemon.commands.terminal.command_line import main
from daemon.recording.recovery import RECOVERY, Recovered, recover, recover_unfinished
from daemon.recording.run_reader import RunMessage, RunReader
from daemon.recording.run_writer import RunWriter
from tests.daemon.recording.synthetic_run import BOOT_NS, WALL_NS
from tests.experiments.damaged_recordings import table, try_all

MESSAGES_IN_A_CHUNK = 6
ZSTD_FRAME = b"\x28\xb5\x2f\xfd"


class Unfinished:
    """The bytes of a recording in several chunks, as they stand before it is finished."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        writer = RunWriter(folder / "whole.mcap", {"robot": "soft_arm"}, WALL_NS - BOOT_NS)
        for number in range(60):
            topic = ("/axes", "/risk", "/raw/tracker")[number % 3]
            writer.write(topic, BOOT_NS + number, b'{"sequence":%d}' % number)
            if number % MESSAGES_IN_A_CHUNK == MESSAGES_IN_A_CHUNK - 1:
                writer.flush()
        self.unfinished = (folder / "whole.mcap.part").read_bytes()
        writer.finish()
        self.finished = (folder / "whole.mcap").read_bytes()
        self.messages = list(RunReader(folder / "whole.mcap").messages())

    def recovered(self, content: bytes) -> tuple[Recovered, list[RunMessage]]:
        """What recovery makes of a file with this content."""
        run = self.folder / "run"
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir()
        (run / "run.mcap.part").write_bytes(content)
        outcome = recover(run / "run.mcap")
        assert outcome is not None
        path = run / "run.mcap"
        return outcome, list(RunReader(path).messages()) if path.exists() else []


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Unfinished]:
    yield Unfinished(tmp_path_factory.mktemp("recovery"))


@settings(deadline=None)
@given(data=st.data())
def test_a_file_cut_anywhere_gives_the_beginning_of_its_messages(
    unfinished: Unfinished, data: st.DataObject
) -> None:
    content = data.draw(st.sampled_from([unfinished.unfinished, unfinished.finished]))
    cut = data.draw(st.integers(0, len(content)))
    outcome, messages = unfinished.recovered(content[:cut])
    assert outcome.messages == len(messages)
    assert messages == unfinished.messages[: len(messages)]
    if cut == len(content):
        assert messages == unfinished.messages
    files = {path.name: path.read_bytes() for path in (unfinished.folder / "run").iterdir()}
    if outcome.complete:
        assert set(files) == {"run.mcap"}
    else:
        assert files["run.mcap.damaged"] == content[:cut]
        assert outcome.lost_bytes > 0
        assert ("run.mcap" in files) == bool(messages)


@settings(deadline=None)
@given(data=st.data())
def test_damaged_bytes_cost_what_is_in_their_chunk_and_nothing_else(
    unfinished: Unfinished, data: st.DataObject
) -> None:
    content = bytearray(unfinished.unfinished)
    place = data.draw(st.integers(0, len(content) - 1))
    for at in range(place, min(place + data.draw(st.integers(1, 8)), len(content))):
        content[at] ^= data.draw(st.integers(1, 255))
    outcome, messages = unfinished.recovered(bytes(content))
    missing = [message for message in unfinished.messages if message not in messages]
    assert [message for message in unfinished.messages if message in messages] == messages
    assert len(missing) <= 2 * MESSAGES_IN_A_CHUNK
    files = {path.name: path.read_bytes() for path in (unfinished.folder / "run").iterdir()}
    if missing or not outcome.complete:
        assert files["run.mcap.damaged"] == bytes(content)
        assert not outcome.complete
    if outcome.lost_messages:
        assert outcome.lost_messages == len(missing)


@pytest.mark.parametrize("place", [0, 8, 16, 40])
def test_damage_before_the_first_chunk_costs_no_message(unfinished: Unfinished, place: int) -> None:
    content = bytearray(unfinished.unfinished)
    content[place : place + 8] = b"\xff" * 8
    outcome, messages = unfinished.recovered(bytes(content))
    assert messages == unfinished.messages
    assert not outcome.complete
    assert outcome.kept is not None
    assert outcome.kept.read_bytes() == bytes(content)
    reader = RunReader(unfinished.folder / "run" / "run.mcap")
    assert list(reader.messages())
    assert reader.metadata["run"] == {"robot": "soft_arm", "wall_offset_ns": str(WALL_NS - BOOT_NS)}


def test_a_chunk_with_a_damaged_head_is_saved_by_its_checksum(unfinished: Unfinished) -> None:
    content = bytearray(unfinished.unfinished)
    content_at = content.index(ZSTD_FRAME, content.index(ZSTD_FRAME) + 1)
    content[content_at - 53 : content_at - 20] = bytes(33)
    outcome, messages = unfinished.recovered(bytes(content))
    assert messages == unfinished.messages
    assert outcome.complete


def test_channels_that_the_first_chunk_declared_outlive_it(unfinished: Unfinished) -> None:
    content = bytearray(unfinished.unfinished)
    content[content.index(ZSTD_FRAME) + 40] ^= 0xFF
    outcome, messages = unfinished.recovered(bytes(content))
    assert messages == unfinished.messages[MESSAGES_IN_A_CHUNK:]
    assert outcome.lost_messages == MESSAGES_IN_A_CHUNK
    assert "6 known to be lost" in str(outcome)
    path = unfinished.folder / "run" / "run.mcap"
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    schemas = {channel.topic: channel.schema_id for channel in summary.channels.values()}
    assert summary.schemas[schemas["/axes"]].name == "tentacled.axes/1"
    assert schemas["/raw/tracker"] == 0


def test_the_command_takes_the_unfinished_file_by_its_name_as_well(
    unfinished: Unfinished, tmp_path: Path
) -> None:
    part = tmp_path / "run.mcap.part"
    part.write_bytes(unfinished.unfinished)
    assert main(["recover", str(part)]) == EXIT_OK
    assert list(RunReader(tmp_path / "run.mcap").messages()) == unfinished.messages


def test_what_cannot_be_read_at_all_is_kept_and_told_once(tmp_path: Path) -> None:
    (tmp_path / "run.mcap.part").write_bytes(MCAP0_MAGIC + b"\xff" * 1000)
    (outcome,) = recover_unfinished(tmp_path)
    assert "no message in it can be read" in str(outcome)
    assert not outcome.complete
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap.damaged"]
    assert recover_unfinished(tmp_path) == []


def test_a_new_file_that_does_not_hold_everything_replaces_nothing(
    unfinished: Unfinished, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.recording.format.mcap_file.MCAP0_MAGIC", b"\x89MCAP1\r\n")
    outcome, _ = unfinished.recovered(unfinished.unfinished)
    assert "cannot be recovered now" in outcome.problem
    part = unfinished.folder / "run" / "run.mcap.part"
    assert part.read_bytes() == unfinished.unfinished


def test_zeros_at_the_end_as_after_a_power_cut_are_left_out(unfinished: Unfinished) -> None:
    _, messages = unfinished.recovered(unfinished.unfinished + bytes(5000))
    assert messages == unfinished.messages


def test_a_recovered_file_has_an_index_and_says_that_it_was_recovered(
    unfinished: Unfinished,
) -> None:
    within_the_last_chunk = unfinished.unfinished.rindex(b"zstd")
    outcome, messages = unfinished.recovered(unfinished.unfinished[:within_the_last_chunk])
    assert 0 < outcome.messages < 60
    assert outcome.lost_bytes > 0
    assert str(outcome).endswith("; the damaged file is kept as run.mcap.damaged")
    with (unfinished.folder / "run" / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(messages)
        names = [record.name for record in reader.iter_metadata()]
    assert names == ["run", RECOVERY]


def test_a_recording_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run.mcap", {}, 0)
    writer.write("/axes", 1, b"{}")
    writer.flush()
    assert recover_unfinished(tmp_path) == []
    assert writer.finish()
    assert recover_unfinished(tmp_path) == []


def test_all_runs_of_a_folder_are_recovered_and_the_others_left(
    tmp_path: Path, unfinished: Unfinished
) -> None:
    for name, content in (("b", unfinished.unfinished), ("a", b""), ("c", b"no recording")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap.part").write_bytes(content)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "run.mcap").write_bytes(unfinished.finished)
    outcomes = recover_unfinished(tmp_path)
    assert [(outcome.path.parent.name, outcome.messages) for outcome in outcomes] == [
        ("a", 0),
        ("b", 60),
        ("c", 0),
    ]
    assert "not a recording" in outcomes[2].problem
    assert (tmp_path / "c" / "run.mcap.part").read_bytes() == b"no recording"
    assert (tmp_path / "d" / "run.mcap").read_bytes() == unfinished.finished


def test_a_folder_that_is_not_there_has_nothing_to_recover(tmp_path: Path) -> None:
    assert recover_unfinished(tmp_path / "runs") == []


def test_recordings_damaged_at_random_lose_no_more_than_they_must() -> None:
    found = try_all(count=24, seed=3, cycle_s=3.0)
    print(table(found))
    assert all(sound for _, sound in found)
    assert any(one.complete for one, _ in found) or all(one.kept for one, _ in found)
    assert all(one.saved for one, _ in found if "noise" in one.damage or "zeros" in one.damage)
    assert any(one.known_lost for one, _ in found)
