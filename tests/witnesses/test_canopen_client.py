"""The third-party `canopen` library as master, against emulated drives in another process.

Codec errors that master and emulated drive share would cancel out; this client shares none of it.
"""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402
from canopen.sdo.client import SdoClient

ROOT = Path(__file__).parents[2]
EDS = ROOT / "config" / "eds" / "stepper.eds"
EDS3 = ROOT / "config" / "eds" / "stepper3.eds"

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("drives")]

PATIENCE_S = 60.0


class Drives:
    """The process with the drives."""

    def __init__(self, folder: Path, eds: Path, *nodes: int) -> None:
        arguments = [str(folder / "can0.sock"), str(eds), *map(str, nodes)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.witnesses.drives_process", *arguments],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.reached_at: dict[str, str] = json.loads(self.process.stdout.readline())

    def inject(self, order: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(order + "\n")
        self.process.stdin.flush()

    def close(self) -> None:
        self.process.communicate(timeout=PATIENCE_S)
        assert self.process.returncode == 0


@pytest.fixture(autouse=True)
def patient_client(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library gives answers fractions of a second, which a loaded machine needs for itself."""
    monkeypatch.setattr(SdoClient, "RESPONSE_TIMEOUT", 5.0)
    for name, limit_s in vars(BaseNode402).items():
        if name.startswith("TIMEOUT_"):
            monkeypatch.setattr(BaseNode402, name, max(limit_s, 10.0))


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drives]:
    running = Drives(tmp_path_factory.mktemp("lab"), EDS, 1, 2)
    yield running
    running.close()


@pytest.fixture(scope="module", params=["socket", "slcan"])
def network(request: pytest.FixtureRequest, drives: Drives) -> Iterator[Any]:
    """The library's network, over our python-can interface and over python-can's own SLCAN."""
    connected = canopen.Network()
    if request.param == "socket":
        connected.connect(interface="tentacled", channel=drives.reached_at["socket"])
    else:
        channel = drives.reached_at["slcan"]
        connected.connect(interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0)
    yield connected
    connected.disconnect()


def added(network: Any, node_id: int = 1) -> Any:
    """A drive fresh from its reset."""
    node = BaseNode402(node_id, str(EDS))  # type: ignore[no-untyped-call]
    network.add_node(node)
    booted = threading.Event()  # the library's own waiting misses what comes before it
    node.nmt.add_heartbeat_callback(lambda state: booted.set() if state == 0 else None)
    node.nmt.state = "RESET"
    assert booted.wait(PATIENCE_S)
    return node


def wait_for_state(node: Any, wanted: str) -> None:
    """Wait for a heartbeat that tells it."""
    deadline_s = time.monotonic() + PATIENCE_S
    while node.nmt.wait_for_heartbeat(PATIENCE_S) != wanted:
        assert time.monotonic() < deadline_s, f"it is still {node.nmt.state}"


def test_sdo_transfers(network: Any) -> None:
    node = added(network)
    assert node.sdo["Device type"].raw == 0x00040192
    assert node.sdo["Manufacturer device name"].raw == "Emulated stepper drive"
    assert node.sdo["Software position limit"]["Min position limit"].raw == -(2**31)
    node.sdo["Profile velocity"].raw = 12_345
    assert node.sdo["Profile velocity"].raw == 12_345
    with pytest.raises(canopen.SdoAbortedError) as raised:
        node.sdo.upload(0x1234, 0)
    assert raised.value.code == 0x06020000
    with pytest.raises(canopen.SdoAbortedError) as raised:
        node.sdo.download(0x1000, 0, b"\x00\x00\x00\x00")
    assert raised.value.code == 0x06010002


def test_heartbeats_and_nmt(network: Any) -> None:
    node = added(network)
    node.sdo["Producer heartbeat time"].raw = 50
    wait_for_state(node, "PRE-OPERATIONAL")
    node.nmt.state = "OPERATIONAL"
    wait_for_state(node, "OPERATIONAL")
    node.nmt.state = "STOPPED"
    wait_for_state(node, "STOPPED")


def test_the_library_enables_a_drive_and_moves_it(network: Any) -> None:
    node = added(network)
    node.sdo["Profile acceleration"].raw = 100_000
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    node.op_mode = "PROFILED POSITION"
    assert node.op_mode == "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    assert node.state == "OPERATION ENABLED"
    node.sdo["Target position"].raw = 1500
    node.controlword = 0x1F
    deadline_s = time.monotonic() + PATIENCE_S
    while abs(node.sdo["Position actual value"].raw - 1500) > 1:
        assert time.monotonic() < deadline_s
    node.controlword = 0x0F
    node.state = "SWITCHED ON"
    assert node.state == "SWITCHED ON"


def test_homing_by_the_library(network: Any) -> None:
    node = added(network)
    node.tpdo.read()
    node.tpdo[2].enabled = False
    node.tpdo[2].save()
    tpdo = node.tpdo[1]
    tpdo.add_variable(0x6061)
    tpdo.trans_type = 1
    tpdo.save()
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    network.sync.start(0.01)
    try:
        assert node.homing(timeout=PATIENCE_S)
    finally:
        network.sync.stop()


def test_pdos_configured_by_the_library(network: Any) -> None:
    node = added(network)
    node.tpdo.read()
    node.rpdo.read()
    tpdo, rpdo = node.tpdo[1], node.rpdo[1]
    for pdo, indices in ((tpdo, (0x6041, 0x6064, 0x6077)), (rpdo, (0x6040, 0x607A))):
        pdo.clear()
        for index in indices:
            pdo.add_variable(index)
        pdo.trans_type = 1
        pdo.enabled = True
        pdo.save()
    node.sdo["Modes of operation"].raw = 8
    node.sdo["Interpolation time period"][1].raw = 10
    received = threading.Semaphore(0)  # waiting for the library's own would miss an early one
    tpdo.add_callback(lambda _: received.release())
    node.nmt.state = "OPERATIONAL"
    positions = []
    for cycle in range(100):
        rpdo["Controlword"].raw = (0x06, 0x07, 0x0F)[min(cycle // 3, 2)]
        # Bumpless: the target stays where the drive is until it follows; at the end it stands.
        rpdo["Target position"].raw = min(max(0, cycle - 25), 35) * 20
        rpdo.transmit()
        network.sync.transmit()
        assert received.acquire(timeout=PATIENCE_S)
        positions.append(tpdo["Position actual value"].raw)
        time.sleep(0.01)
    assert tpdo["Statusword"].raw & 0x6F == 0x27
    assert positions[25] == 0
    assert positions == sorted(positions)
    assert positions[-1] == pytest.approx(35 * 20, abs=2)


def test_emergencies(network: Any, drives: Drives) -> None:
    node = added(network)
    told = threading.Event()
    codes: list[int] = []

    def on_emergency(error: Any) -> None:
        codes.append(error.code)
        told.set()

    node.emcy.add_callback(on_emergency)
    drives.inject("drive.can0/1.emergency=0x8611")
    assert told.wait(PATIENCE_S)
    assert codes == [0x8611]
    assert node.sdo["Pre-defined error field"][1].raw == 0x8611
    assert node.sdo["Error register"].raw == 0x21


def test_two_drives_at_once(network: Any) -> None:
    nodes = [added(network, node_id) for node_id in (1, 2)]
    serials = {node.sdo["Identity object"]["Serial number"].raw for node in nodes}
    assert len(serials) == 2
    network.nmt.state = "OPERATIONAL"
    for node in nodes:
        node.sdo["Producer heartbeat time"].raw = 50
    for node in nodes:
        wait_for_state(node, "OPERATIONAL")


def test_a_module_with_three_axes(tmp_path: Path) -> None:
    drives = Drives(tmp_path, EDS3, 5)
    network = canopen.Network()
    network.connect(interface="tentacled", channel=drives.reached_at["socket"])
    try:
        node = canopen.RemoteNode(5, str(EDS3))
        network.add_node(node)
        assert node.sdo[0x1000].raw == 0xFFFF0192
        for axis in range(3):
            node.sdo[0x6060 + 0x800 * axis].raw = 3
            assert node.sdo[0x6061 + 0x800 * axis].raw == 3
    finally:
        network.disconnect()
        drives.close()
