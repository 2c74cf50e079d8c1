"""Storing parameters and restoring defaults."""

import pytest

from tests.sim_backends.drive.rig import MS, NODE, Rig

SAVE, LOAD = 0x65766173, 0x64616F6C
CANNOT_STORE, DEVICE_STATE = 0x08000020, 0x08000022


def stored(rig: Rig, subindex: int) -> None:
    """Writes the signature and waits as long as storing takes."""
    request = bytes((0x23, 0x10, 0x10, subindex)) + SAVE.to_bytes(4, "little")
    answer = rig.ask(request, 500)
    assert answer is not None
    assert answer[0] == 0x60


def restarted(rig: Rig) -> None:
    rig.fault("power_cycle=10ms")
    rig.run(500)


def test_what_is_stored_survives_a_loss_of_power_and_nothing_else_does() -> None:
    rig = Rig()
    rig.set(0x6083, 777)
    rig.set(0x1017, 50)
    stored(rig, 1)
    rig.set(0x6084, 888)
    restarted(rig)
    assert (rig.get(0x6083), rig.get(0x1017), rig.get(0x6084)) == (777, 50, 100_000)


@pytest.mark.parametrize(("subindex", "kept"), [(2, (100_000, 50)), (3, (777, 0))])
def test_areas_can_be_stored_one_by_one(subindex: int, kept: tuple[int, int]) -> None:
    rig = Rig()
    rig.set(0x6083, 777)
    rig.set(0x1017, 50)
    stored(rig, subindex)
    restarted(rig)
    assert (rig.get(0x6083), rig.get(0x1017)) == kept


def test_a_stored_pdo_mapping_works_after_power_on() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [0x60640020], 1)
    stored(rig, 1)
    restarted(rig)
    rig.operational()
    rig.sync()
    rig.run(1)
    assert rig.frames(tpdo) == [bytes(4)]


def test_restoring_takes_effect_with_the_next_reset() -> None:
    rig = Rig()
    rig.set(0x6083, 777)
    stored(rig, 1)
    rig.ask(bytes((0x23, 0x11, 0x10, 0x01)) + LOAD.to_bytes(4, "little"), 500)
    assert rig.get(0x6083) == 777
    rig.nmt(0x81)
    rig.run(400)
    assert rig.get(0x6083) == 100_000


@pytest.mark.parametrize(("index", "signature"), [(0x1010, LOAD), (0x1011, SAVE), (0x1010, 1)])
def test_the_signature_must_be_right(index: int, signature: int) -> None:
    rig = Rig()
    assert rig.refused(index, 1, signature) == CANNOT_STORE
    assert rig.read(index, 1) == 1


def test_an_enabled_drive_stores_nothing() -> None:
    rig = Rig()
    rig.enable(8)
    assert rig.refused(0x1010, 1, SAVE) == DEVICE_STATE


def test_storing_takes_its_time() -> None:
    rig = Rig()
    start_ns = rig.bus.now_ns
    request = bytes((0x23, 0x10, 0x10, 0x01)) + SAVE.to_bytes(4, "little")
    rig.master.send(0x600 + NODE, request, start_ns)
    rig.run(1000)
    ((_, _, end_ns),) = rig.heard
    assert 290 * MS < end_ns - start_ns < 320 * MS


def test_the_error_history_is_not_stored() -> None:
    rig = Rig()
    rig.fault("emergency=0x2310")
    rig.control(0x00, 0x80)
    stored(rig, 1)
    restarted(rig)
    assert rig.get(0x1003) == 0
