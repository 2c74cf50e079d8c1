"""Wireshark's CANopen dissector on what the capture wrote: it shares no code with us."""

import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from statistics import median

import pytest

from drivers.can.capture import read_capture
from tests.hil.processes import PATIENCE_S, event, lab, operational, probe

pytestmark = [
    pytest.mark.hil,
    pytest.mark.xdist_group("hil"),
    pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed"),
]

SDO_TIMED_OUT = "0x05040000"


def tshark(capture: Path, *arguments: str) -> list[str]:
    """The lines that tshark prints of a capture."""
    command = ["tshark", "-r", str(capture), "-d", "can.subdissector,canopen", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    return done.stdout.splitlines()


def fields(capture: Path, shown: str, *names: str) -> list[str]:
    """Fields of the frames that a display filter lets through."""
    options = [option for name in names for option in ("-e", name)]
    return tshark(capture, "-Y", shown, "-T", "fields", *options)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bring-up, some seconds of cycles, a fault, a restart, and the end."""
    folder = tmp_path_factory.mktemp("capture")
    capture = folder / "session.pcap"
    with (
        lab(folder / "lab", "--play", "sway") as running,
        probe(folder / "lab", "--capture", str(capture)) as watching,
    ):
        watching.wait_for(operational)
        running.inject("drive.can0/2.emergency=0x7305")
        watching.wait_for(event("drive_emergency", "can0/2"))
        running.inject("drive.can0/5.reset")
        watching.wait_for(event("node_reset", "can0/5"))
        watching.wait_for(
            lambda line: operational(line) and line["buses"]["can0"]["received"] > 2000
        )
        assert watching.end() in (0, 1)
    return capture


def test_every_frame_is_read_and_none_is_malformed(session: Path) -> None:
    frames = list(read_capture(session.read_bytes()))
    assert len(frames) > 2000
    assert len(tshark(session)) == len(frames)
    assert tshark(session, "-Y", "_ws.malformed || _ws.expert.severity >= 0x600000") == []


def test_no_transfer_was_aborted_but_for_want_of_time(session: Path) -> None:
    codes = fields(session, "canopen.sdo.abort_code", "canopen.sdo.abort_code")
    assert set(codes) <= {SDO_TIMED_OUT}


def test_the_dissector_sees_what_we_meant(session: Path) -> None:
    states = fields(session, "canopen.nmt_guard.state", "canopen.cob_id", "canopen.nmt_guard.state")
    told = {tuple(line.split("\t")) for line in states}
    for node in range(1, 7):
        assert (f"0x{0x700 + node:08x}", "0x05") in told
    commands = fields(session, "canopen.nmt_ctrl.cd", "canopen.nmt_ctrl.cd")
    assert {"0x01", "0x82", "0x80"} <= set(commands)
    errors = fields(session, "canopen.em.err_code", "canopen.em.err_code", "canopen.node_id")
    assert any(line.lower().startswith("0x7305") for line in errors)
    read = fields(session, "canopen.sdo.main_idx", "canopen.sdo.main_idx")
    safety = (0x1016, 0x1029, 0x6007, 0x605A, 0x605E, 0x6085, 0x607D, 0x6065, 0x6066, 0x6072)
    for index in (*safety, 0x607E):
        assert f"0x{index:04x}" in set(read)
    assert len(fields(session, "canopen.pdo.data.bytes", "frame.number")) > 500


def test_times_run_forward_and_syncs_keep_their_period(session: Path) -> None:
    times = [float(line) for line in fields(session, "frame.number > 0", "frame.time_relative")]
    assert times == sorted(times)
    syncs = [float(t) for t in fields(session, "can.id == 0x80", "frame.time_relative")]
    gaps = [later - sooner for sooner, later in pairwise(syncs)]
    # A busy machine is late now and then; in its best half second it is not.
    medians = [median(gaps[start : start + 50]) for start in range(0, len(gaps) - 50, 10)]
    assert min(medians, key=lambda gap: abs(gap - 0.01)) == pytest.approx(0.01, abs=0.001)
