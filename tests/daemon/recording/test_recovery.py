"""An unfinished recording is made whole: whatever was complete is kept, and nothing ever raises."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from daemon.recording.recovery import RECOVERY, Recovered, recover, recover_unfinished
from daemon.recording.run_reader import RunMessage, RunReader
from daemon.recording.run_writer import RunWriter
from tests.daemon.recording.synthetic_run import BOOT_NS, WALL_NS


class Unfinished:
    """The bytes of a recording in several chunks, as they stand before it is finished."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        writer = RunWriter(folder / "whole.mcap", {"robot": "soft_arm"}, WALL_NS - BOOT_NS)
        for number in range(60):
            topic = ("/axes", "/risk", "/raw/tracker")[number % 3]
            writer.write(topic, BOOT_NS + number, b'{"sequence":%d}' % number)
            if number % 6 == 5:
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
    assert outcome.problem == ""
    assert outcome.messages == len(messages)
    assert messages == unfinished.messages[: len(messages)]
    if cut == len(content):
        assert messages == unfinished.messages
    assert [path.name for path in (unfinished.folder / "run").iterdir()] == ["run.mcap"]


@settings(deadline=None)
@given(data=st.data())
def test_damaged_bytes_cost_chunks_but_invent_nothing(
    unfinished: Unfinished, data: st.DataObject
) -> None:
    content = bytearray(unfinished.unfinished)
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    outcome, messages = unfinished.recovered(bytes(content))
    assert [message.data for message in messages if message in unfinished.messages] == [
        message.data for message in messages
    ]
    if place < 8:
        assert "left as it is" in outcome.problem
        assert (unfinished.folder / "run" / "run.mcap.part").exists()


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
    assert str(outcome).endswith("bytes at the end were cut short")
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
    assert [(outcome.folder.name, outcome.messages) for outcome in outcomes] == [
        ("a", 0),
        ("b", 60),
        ("c", 0),
    ]
    assert "not a recording" in outcomes[2].problem
    assert (tmp_path / "c" / "run.mcap.part").read_bytes() == b"no recording"
    assert (tmp_path / "d" / "run.mcap").read_bytes() == unfinished.finished


def test_a_folder_that_is_not_there_has_nothing_to_recover(tmp_path: Path) -> None:
    assert recover_unfinished(tmp_path / "runs") == []
