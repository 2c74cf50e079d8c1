"""Emergencies, error register and history."""

from tests.sim_backends.drive.rig import NODE, Rig


def test_an_error_is_told_registered_and_remembered() -> None:
    rig = Rig()
    rig.fault("emergency=0x2310")
    rig.run(1)
    assert rig.frames(0x080 + NODE) == [bytes.fromhex("1023030000000000")]
    assert rig.read(0x1001) == 0x03
    assert rig.read(0x1003, 0) == 1
    assert rig.read(0x1003, 1) == 0x2310


def test_the_end_of_an_error_is_told() -> None:
    rig = Rig()
    rig.fault("emergency=0x2310")
    rig.control(0x00, 0x80)
    rig.run(1)
    assert rig.emergencies() == [0x2310, 0x0000]
    assert rig.read(0x1001) == 0
    assert rig.read(0x1003, 0) == 1


def test_the_history_holds_the_newest_eight_newest_first() -> None:
    rig = Rig()
    for code in range(0x1001, 0x100B):
        rig.fault(f"emergency={code}")
        rig.control(0x00, 0x80)
        rig.run(1)
    assert rig.read(0x1003, 0) == 8
    assert [rig.read(0x1003, place) for place in range(1, 9)] == list(range(0x100A, 0x1002, -1))


def test_the_history_is_cleared_by_writing_zero_and_nothing_else() -> None:
    rig = Rig()
    rig.fault("emergency=0x2310")
    assert rig.refused(0x1003, 0, 1) == 0x06090031
    assert rig.read(0x1003, 0) == 1
    rig.write(0x1003, 0, 0)
    assert rig.read(0x1003, 0) == 0
    assert rig.read(0x1003, 1) == 0
    assert rig.refused(0x1003, 1, 0) == 0x06010002


def test_the_register_joins_the_errors_that_hold() -> None:
    rig = Rig()
    rig.fault("over_temperature=1s")
    rig.fault("emergency=0x2310")
    rig.run(1)
    assert rig.read(0x1001) == 0b1011


def test_emergencies_keep_their_distance() -> None:
    rig = Rig()
    rig.write(0x1015, 0, 1000)  # 100 ms
    rig.fault("emergency=0x1001")
    rig.fault("emergency=0x1002")
    rig.fault("emergency=0x1003")
    rig.run(50)
    assert rig.emergencies() == [0x1001]
    rig.run(100)
    assert rig.emergencies() == [0x1002]
    rig.run(100)
    assert rig.emergencies() == [0x1003]


def test_a_stopped_drive_tells_later() -> None:
    rig = Rig()
    rig.nmt(0x02)
    rig.fault("emergency=0x2310")
    rig.run(100)
    assert rig.emergencies() == []
    rig.nmt(0x80)
    rig.run(1)
    assert rig.emergencies() == [0x2310]


def test_another_identifier_or_none() -> None:
    rig = Rig()
    assert rig.refused(0x1014, 0, 0x0F5) == 0x06090030, "it is in use"
    rig.write(0x1014, 0, 0x80000080 | NODE)
    rig.write(0x1014, 0, 0x0F5)
    rig.fault("emergency=0x2310")
    rig.run(1)
    assert len(rig.frames(0x0F5)) == 1
    assert rig.refused(0x1014, 0, 0x185) == 0x06090030
    assert rig.refused(0x1014, 0, 0x200000F5) == 0x06090030
    rig.write(0x1014, 0, 0x800000F5)
    rig.fault("emergency=0x2320")
    rig.run(1)
    assert rig.frames(0x0F5) == []
