"""A recorder that dies is started again, the gap is told, and nothing moves unrecorded for long."""

import asyncio
import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from config.robot import Robot
from daemon.messages import Arm, Resume, Stop
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.flight_recorder import RecorderStatus, RecordingError
from daemon.recording.recovery import recover_unfinished
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from safety.states import OperatingState
from tests.daemon.service import rig as rigs
from tests.daemon.service.rig import Rig, on_a_rig

S = OperatingState


class MortalRecorder(DirectRecorder):
    """Its process can be killed, and may refuse to start."""

    def __init__(self) -> None:
        super().__init__()
        self.killed = False
        self.refuses = False
        self.full = False
        self.too_much = 0
        self.started: list[str] = []

    async def start(
        self,
        folder: Path,
        header: Mapping[str, str],
        t_ns: int,
        wall_ns: int,
        name: str = RUN_FILE,
    ) -> None:
        if self.refuses:
            raise RecordingError("the recorder process did not start in time")
        await super().start(folder, header, t_ns, wall_ns, name)
        self.started.append(name)

    def kill(self) -> None:
        """As SIGKILL does: what was written is there, and the file is not finished."""
        assert self._writer is not None
        self._writer.flush()
        self._writer._file.close()
        self._writer, self.killed = None, True

    async def stop(self) -> None:
        self.killed = False
        await super().stop()

    @property
    def status(self) -> RecorderStatus:
        if self.killed:
            why = "the recorder process has ended by itself"
            return RecorderStatus(False, None, self.too_much, why, None, 0, lost=True)
        if self.full:
            why = "No space left on device"
            return super().status._replace(failed=why, dropped=self.too_much)
        return super().status


@pytest.fixture(autouse=True)
def mortal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rigs, "DirectRecorder", MortalRecorder)


def recorder_of(rig: Rig) -> MortalRecorder:
    recorder = rig.service.dependencies.recorder
    assert isinstance(recorder, MortalRecorder)
    return recorder


def test_a_killed_recorder_goes_on_in_a_new_file_and_the_gap_is_told(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder_of(rig).kill()
        await rig.until(lambda: bool(rig.events("note", "recording_gap")), 3.0)
        assert rig.in_state(S.RUNNING)
        assert "are missing" in rig.events("note", "recording_gap")[0].text
        assert rig.events("note", "recorder_lost")
        await rig.until(lambda: "recorder_failed" not in rig.causes, 1.0)
        assert recorder_of(rig).started == ["run.mcap", "run-2.mcap"]
        await rig.do(Stop)
        await rig.until_state(S.READY)

    on_a_rig(scene, folder=tmp_path)
    outcomes = recover_unfinished(tmp_path)
    assert [outcome.path.name for outcome in outcomes if outcome.messages] == ["run.mcap"]
    second = RunReader(tmp_path / "run-2.mcap")
    told = b"".join(message.data for message in second.messages(["/event"]))
    assert b"recording goes on in" in told
    assert second.whole
    assert second.metadata["run"]["goes_on_after_gap"] == "1"


def test_a_recording_that_goes_on_in_another_folder_is_explained_there(tmp_path: Path) -> None:
    begun: list[Path | None] = []

    async def scene(rig: Rig) -> None:
        recording, others = rig.recording, iter(range(2, 9))

        async def another_folder() -> Path:
            folder = tmp_path / f"run-{next(others)}"
            folder.mkdir()
            return folder

        await rig.running()
        recording.begun.append(lambda: begun.append(recording.folder))
        recording._make_folder = another_folder
        for _ in range(2):
            recorder_of(rig).kill()
            await rig.until(lambda: not recorder_of(rig).killed, 5.0)
            await rig.until(lambda: recorder_of(rig).status.recording, 5.0)
        await rig.until(lambda: bool(begun), 1.0)
        await rig.do(Stop)
        await rig.until_state(S.READY)

    on_a_rig(scene, folder=tmp_path)
    assert begun == [tmp_path / "run-2"], "what goes on where it was is explained there already"


def test_where_recording_stays_impossible_the_robot_is_held_and_may_be_armed_again(
    tmp_path: Path,
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        recorder.refuses = True
        recorder.kill()
        await rig.until_state(S.HOLD, within_s=5.0)
        assert {"not_recorded", "recorder_failed"} <= rig.causes
        refusal = await rig.refused(Resume)
        assert "not_recorded" in {reason.name for reason in refusal.reasons}
        await rig.do(Stop)
        await rig.until_state(S.READY)
        refused = await rig.refused(Arm)
        assert refused.name == "not_recording"
        recorder.refuses = False
        (tmp_path / "run.mcap.part").unlink()  # the next run would have a folder of its own
        await rig.do(Arm)
        assert "not_recorded" not in rig.causes

    on_a_rig(scene, folder=tmp_path)


def test_the_robot_is_held_where_a_disk_takes_nothing_until_parts_are_missing() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        recorder.full = True
        await asyncio.sleep(2.0)
        assert rig.in_state(S.RUNNING), "what comes waits, and nothing is missing"
        assert rig.causes == {"recorder_failed"}
        recorder.too_much = 1
        await rig.until_state(S.HOLD, within_s=1.0)
        assert "not_recorded" in rig.causes
        await rig.refused(Resume)
        recorder.full = False
        await rig.until(lambda: "not_recorded" not in rig.causes, within_s=1.0)
        await rig.do(Resume)
        await asyncio.sleep(1.0)
        assert rig.in_state(S.RUNNING)

    on_a_rig(scene)


def test_what_is_missing_where_a_recorder_died_holds_nobody_while_it_is_begun_again() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        recorder.too_much, recorder.refuses = 5, True
        recorder.kill()
        await asyncio.sleep(0.3)
        recorder.refuses = False  # the next attempt is made 0.5 s after the first
        await rig.until(lambda: not recorder.killed and recorder.status.recording, 5.0)
        assert rig.in_state(S.RUNNING)
        assert len(recorder.started) == 2

    on_a_rig(scene)


def test_a_robot_file_may_say_that_motion_goes_on_unrecorded() -> None:
    def change(robot: Robot) -> Robot:
        supervision = robot.supervision.model_copy(update={"recording_required": False})
        return robot.model_copy(update={"supervision": supervision})

    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        recorder.refuses = True
        recorder.kill()
        await rig.until(lambda: bool(rig.recording.look().lost), 5.0)
        await asyncio.sleep(0.5)
        assert rig.in_state(S.RUNNING)
        assert "recorder_failed" in rig.causes
        assert "not_recorded" not in rig.causes
        await rig.do(Stop)
        await rig.until_state(S.READY)

    on_a_rig(scene, change=change)


def test_a_recorder_that_dies_again_and_again_is_given_up() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        for _ in range(3):
            recorder.kill()
            await rig.until(lambda: not recorder.killed and recorder.status.recording, 5.0)
        recorder.kill()
        await rig.until_state(S.HOLD, within_s=5.0)
        assert len(recorder.started) == 4
        assert "not_recorded" in rig.causes

    on_a_rig(scene)


def test_a_run_whose_folder_was_deleted_ends_in_words_and_not_in_an_error(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()

    async def scene(rig: Rig) -> None:
        await rig.running()
        recorder = recorder_of(rig)
        recorder.refuses = True
        recorder.kill()
        await rig.until_state(S.HOLD, within_s=5.0)
        shutil.rmtree(folder)
        await rig.do(Stop)
        await rig.until(lambda: bool(rig.events("note", "no_result")))

    on_a_rig(scene, folder=folder)
