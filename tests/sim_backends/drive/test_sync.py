"""SYNC: its counter, its length, its loss."""

import pytest

from tests.sim_backends.drive.rig import Rig

CSP, CSV, PP, PV = 8, 9, 1, 3
STATUSWORD = 0x60410010


def test_another_identifier() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD], 1)
    rig.operational()
    rig.write(0x1005, 0, 0x90)
    rig.sync()
    rig.run(1)
    assert rig.frames(tpdo) == []
    rig.send(0x90)
    rig.run(1)
    assert len(rig.frames(tpdo)) == 1


@pytest.mark.parametrize("value", [1 << 30 | 0x80, 1 << 29 | 0x80, 0x7F])
def test_a_drive_generates_no_sync_and_hears_no_odd_one(value: int) -> None:
    assert Rig().refused(0x1005, 0, value) == 0x06090030


def test_the_counter_is_set_while_there_is_no_period() -> None:
    rig = Rig()
    assert rig.refused(0x1019, 0, 1) == 0x06090030
    rig.write(0x1006, 0, 10_000)
    assert rig.refused(0x1019, 0, 10) == 0x08000022
    rig.write(0x1006, 0, 0)
    assert rig.refused(0x1019, 0, 10) == 0


@pytest.mark.parametrize(("overflow", "counter"), [(0, 5), (10, None)])
def test_a_counter_on_one_side_only_is_told_once_and_the_sync_not_used(
    overflow: int, counter: int | None
) -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD], 1)
    rig.set(0x1019, overflow)
    rig.operational()
    rig.sync(counter)
    rig.sync(counter)
    rig.run(1)
    assert rig.emergencies() == [0x8240]
    assert rig.frames(tpdo) == []
    rig.sync(5 if overflow else None)
    rig.run(1)
    assert rig.emergencies() == [0x0000]
    assert len(rig.frames(tpdo)) == 1


@pytest.mark.parametrize(("mode", "state"), [(CSP, "fault"), (CSV, "fault"), (PP, "enabled")])
def test_without_sync_no_cyclic_mode_goes_on(mode: int, state: str) -> None:
    rig = Rig()
    rig.set(0x1006, 10_000)
    rig.enable(mode)
    for _ in range(10):
        rig.sync()
        rig.run(9.8)
    assert rig.state == "enabled"
    rig.run(80)
    assert rig.state == "enabled"
    rig.run(30)
    assert rig.state == state
    assert rig.get(0x603F) == (0x8700 if state == "fault" else 0)


def test_without_a_period_nobody_watches() -> None:
    rig = Rig()
    rig.enable(CSP)
    rig.sync()
    rig.run(5000)
    assert rig.state == "enabled"


def test_before_the_first_sync_nobody_watches() -> None:
    rig = Rig()
    rig.set(0x1006, 10_000)
    rig.enable(CSP)
    rig.run(5000)
    assert rig.state == "enabled"
