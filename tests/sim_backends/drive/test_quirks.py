"""Ways of real products."""

from typing import get_args

import pytest

from config.emulation.lab import Quirk
from sim_backends.devices.drive.quirks import Quirks
from tests.sim_backends.drive.rig import NODE, Rig

OUT_OF_RANGE, DEVICE_STATE, INCOMPATIBLE = 0x06090030, 0x08000022, 0x06040043
STATUSWORD, MODE_DISPLAY, POSITION = 0x60410010, 0x60610008, 0x60640020


def test_every_quirk_of_the_configuration_is_one() -> None:
    for quirk in get_args(Quirk):
        assert getattr(Quirks.of([quirk]), quirk)
        assert not getattr(Quirks.of([]), quirk)


@pytest.mark.parametrize("quirk", get_args(Quirk))
def test_every_one_boots_and_can_be_enabled(quirk: Quirk) -> None:
    rig = Rig(quirk)
    rig.enable(8)


@pytest.mark.parametrize(("quirks", "count"), [((), 1), (("boots_twice",), 2)])
def test_boots_twice(quirks: tuple[Quirk, ...], count: int) -> None:
    rig = Rig(*quirks, boots=False)
    rig.drive.power_on(0)
    rig.run(400)
    assert rig.states() == [0x00] * count
    rig.nmt(0x81)
    rig.run(400)
    assert rig.states() == [0x00] * count
    rig.nmt(0x82)
    rig.run(400)
    assert rig.states() == [0x00]


def test_csp_not_listed() -> None:
    rig = Rig("csp_not_listed")
    assert rig.read(0x6502) == Rig().read(0x6502) & ~(1 << 7)
    assert rig.refused(0x6060, 0, 8) == 0
    assert rig.read(0x6061) == 8


def test_emcy_short() -> None:
    rig = Rig("emcy_short")
    rig.fault("emergency=0x8611")
    rig.run(1)
    assert [data.hex() for data in rig.frames(0x080 + NODE)] == ["118621"]


def test_fixed_mapping_count() -> None:
    rig = Rig("fixed_mapping_count")
    rig.write(0x1800, 1, 0xC0000180 + NODE)
    assert rig.refused(0x1A00, 0, 0) == 0x06010002
    assert rig.read(0x1A00, 0) == 8
    rig.write(0x1A00, 1, STATUSWORD)
    rig.write(0x1A00, 2, POSITION)
    for place in range(3, 9):
        rig.write(0x1A00, place, 0)
    rig.write(0x1800, 2, 1)
    rig.write(0x1800, 1, 0x40000180 + NODE)
    rig.operational()
    rig.sync()
    rig.run(1)
    assert [len(data) for data in rig.frames(0x180 + NODE)] == [6]


def test_with_a_fixed_count_entries_cannot_grow_beyond_a_pdo() -> None:
    rig = Rig("fixed_mapping_count")
    rig.write(0x1800, 1, 0xC0000180 + NODE)
    assert [rig.refused(0x1A00, place, POSITION) for place in (1, 2, 3)] == [0, 0, 0x06040042]


def test_even_mapping_only() -> None:
    rig = Rig("even_mapping_only")
    rig.write(0x1800, 1, 0xC0000180 + NODE)
    rig.write(0x1A00, 0, 0)
    rig.write(0x1A00, 1, STATUSWORD)
    rig.write(0x1A00, 2, MODE_DISPLAY)
    assert rig.refused(0x1A00, 0, 2) == INCOMPATIBLE
    assert rig.refused(0x1A00, 0, 1) == 0


def test_no_dummy_mapping() -> None:
    rig = Rig("no_dummy_mapping")
    rig.write(0x1400, 1, 0x80000200 + NODE)
    rig.write(0x1600, 0, 0)
    assert rig.refused(0x1600, 1, 0x00050008) == 0x06040041


def test_factory_pdos_flood() -> None:
    rig = Rig("factory_pdos_flood")
    rig.operational()
    rig.run(1)
    rig.heard.clear()
    rig.run(100)
    assert len(rig.frames(0x380 + NODE)) == pytest.approx(50, abs=1)
    assert len(rig.frames(0x480 + NODE)) == pytest.approx(50, abs=1)
    for number in (2, 3):
        rig.write(0x1800 + number, 1, 0xC0000180 + 0x100 * number + NODE)
    rig.heard.clear()
    rig.run(100)
    assert rig.heard == []


def test_guarding_excludes_heartbeat() -> None:
    rig = Rig("guarding_excludes_heartbeat")
    rig.write(0x100C, 0, 100)
    assert rig.refused(0x1017, 0, 50) == INCOMPATIBLE
    rig.write(0x100C, 0, 0)
    rig.write(0x1017, 0, 50)
    assert rig.refused(0x100C, 0, 100) == INCOMPATIBLE


def test_interpolation_index_fixed() -> None:
    rig = Rig("interpolation_index_fixed")
    assert rig.refused(0x60C2, 2, -4) == OUT_OF_RANGE
    assert rig.refused(0x60C2, 2, -3) == 0
    assert rig.refused(0x60C2, 1, 5) == 0
    assert Rig().refused(0x60C2, 2, -4) == 0


def test_interpolation_while_inactive() -> None:
    rig = Rig("interpolation_while_inactive")
    rig.enable(8)
    assert rig.refused(0x60C2, 1, 5) == DEVICE_STATE
    rig.set(0x6060, 1)
    assert rig.refused(0x60C2, 1, 5) == 0


def test_late_sync_holds() -> None:
    rig = Rig("late_sync_holds")
    rig.map(True, 1, [0x607A0020], 1)
    rig.set(0x1006, 10_000)
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    positions = []
    for cycle in range(12):
        late_ms = 1.0 if cycle == 6 else 0.0
        rig.run(9.6 + late_ms - (1.0 if cycle == 7 else 0.0))
        rig.send(0x200 + NODE, ((cycle + 1) * 100).to_bytes(4, "little"))
        rig.sync()
        positions.append((bool(rig.statusword & 1 << 15), rig.get(0x607A)))
        held = rig.get(0x6062)
    assert [late for late, _ in positions].index(True) == 6
    assert sum(late for late, _ in positions) == 1
    assert held > 0


def test_what_is_held_is_the_last_target() -> None:
    rig = Rig("late_sync_holds")
    rig.map(True, 1, [0x607A0020], 1)
    rig.set(0x1006, 10_000)
    rig.set(0x60C2, 10, 1)
    rig.enable(8)

    def cycle(target: int, late_ms: float = 0.0) -> None:
        rig.run(9.6 + late_ms)
        rig.send(0x200 + NODE, target.to_bytes(4, "little"))
        rig.sync()

    for target in (0, 100, 200):
        cycle(target)
    cycle(300, late_ms=1.0)
    assert rig.statusword & 1 << 15
    assert not rig.statusword & 1 << 12
    rig.run(9.6)
    assert rig.get(0x6062) == 200
    rig.send(0x200 + NODE, (400).to_bytes(4, "little"))
    rig.sync()
    assert not rig.statusword & 1 << 15
    rig.run(12)
    assert rig.get(0x6062) == 400


def test_no_encoder() -> None:
    rig = Rig("no_encoder")
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.fault("blocked")
    for target in range(0, 20_000, 1000):
        rig.set(0x607A, target)
        rig.run(10)
    rig.run(500)
    assert rig.state == "enabled"
    assert rig.position == 19_000
    assert rig.get(0x60F4) == 0
    assert rig.axis.position_counts == 0.0


def test_communication_error_stops() -> None:
    rig = Rig("communication_error_stops")
    assert rig.read(0x1029, 1) == 2
    assert rig.refused(0x1029, 1, 0) == OUT_OF_RANGE
    assert rig.refused(0x1029, 1, 1) == 0
    rig.write(0x1029, 1, 2)
    rig.set(0x1016, 127 << 16 | 100, 1)
    rig.operational()
    rig.send(0x77F, b"\x05")
    rig.run(200)
    assert rig.drive.nmt.state == 0x04
