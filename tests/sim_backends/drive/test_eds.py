"""The shipped EDS files, and how a drive's objects come of an EDS."""

from configparser import RawConfigParser
from pathlib import Path

import pytest

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.node.eds import EmulatedEdsError, ObjectDescription, read_eds
from tests.sim_backends.drive.rig import STEPPER, STEPPER3

AXES = {STEPPER: 1, STEPPER3: 3}


def by_key(path: Path) -> dict[tuple[int, int], ObjectDescription]:
    return {(one.index, one.subindex): one for one in read_eds(path).objects}


def parsed(path: Path) -> RawConfigParser:
    parser = RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(path)
    return parser


@pytest.mark.parametrize("path", AXES, ids=lambda path: path.name)
def test_the_lists_name_exactly_the_objects_there_are(path: Path) -> None:
    parser = parsed(path)
    listed: list[int] = []
    for section in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = int(parser[section]["SupportedObjects"])
        listed += [int(parser[section][str(number)], 0) for number in range(1, count + 1)]
        assert len(parser[section]) == count + 1
    described = [int(name, 16) for name in parser.sections() if len(name) == 4]
    assert sorted(listed) == sorted(described)
    assert len(set(listed)) == len(listed)


@pytest.mark.parametrize("path", AXES, ids=lambda path: path.name)
def test_records_have_as_many_members_as_they_say(path: Path) -> None:
    parser = parsed(path)
    for name in parser.sections():
        if len(name) == 4 and "SubNumber" in parser[name]:
            members = [other for other in parser.sections() if other.startswith(f"{name}sub")]
            assert len(members) == int(parser[name]["SubNumber"]), name
            highest = int(parser[f"{name}sub0"].get("DefaultValue", "0"), 0)
            numbers = [int(member.split("sub")[1], 16) for member in members]
            assert highest <= max(numbers), name


@pytest.mark.parametrize("path", AXES, ids=lambda path: path.name)
def test_defaults_lie_within_limits_and_types(path: Path) -> None:
    for one in read_eds(path).objects:
        assert one.name
        if isinstance(one.default, int):
            assert one.low is None or one.default >= one.low, one
            assert one.high is None or one.default <= one.high, one
            size = one.data_type.size
            assert size is not None
            low = -(1 << 8 * size - 1) if one.data_type.signed else 0
            assert low <= one.default < low + (1 << 8 * size), one


@pytest.mark.parametrize(("path", "axes"), AXES.items(), ids=["stepper", "stepper3"])
def test_each_axis_has_four_pdos_each_way_mapped_to_its_own_objects(path: Path, axes: int) -> None:
    objects = by_key(path)
    for axis in range(axes):
        for number in range(4):
            offset = 0x40 * axis + number
            for mapping in (0x1600, 0x1A00):
                count = objects[mapping + offset, 0].default
                assert isinstance(count, int)
                for place in range(1, count + 1):
                    entry = objects[mapping + offset, place].default
                    assert isinstance(entry, int)
                    target = objects[entry >> 16, entry >> 8 & 0xFF]
                    assert target.mappable
                    assert target.bits == entry & 0xFF
                    assert target.index - 0x800 * axis in range(0x6000, 0x6800)


def test_the_axes_of_the_module_are_those_of_the_single_drive() -> None:
    single, module = by_key(STEPPER), by_key(STEPPER3)
    for (index, subindex), one in single.items():
        if index < 0x6000:
            continue
        for axis in range(3):
            other = module[index + 0x800 * axis, subindex]
            assert other.data_type is one.data_type
            assert (other.default, other.low, other.high) == (one.default, one.low, one.high)
            assert (other.readable, other.writable, other.mappable) == (
                one.readable,
                one.writable,
                one.mappable,
            )


def test_what_a_description_takes_from_the_file() -> None:
    objects = by_key(STEPPER)
    heartbeat = objects[0x1016, 1]
    assert (heartbeat.data_type, heartbeat.high) == (DataType.UNSIGNED32, 0x7FFFFF)
    tpdo = objects[0x1800, 1]
    assert (tpdo.default, tpdo.plus_node_id) == (0x40000180, True)
    limit = objects[0x607D, 1]
    assert limit.default == -(2**31)
    assert objects[0x1008, 0].default == b"Emulated stepper drive"
    assert not objects[0x6041, 0].writable
    assert read_eds(STEPPER).dummies == {
        DataType.INTEGER8,
        DataType.INTEGER16,
        DataType.INTEGER32,
        DataType.UNSIGNED8,
        DataType.UNSIGNED16,
        DataType.UNSIGNED32,
    }


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(EmulatedEdsError, match=r"none\.eds"):
        read_eds(tmp_path / "none.eds")


@pytest.mark.parametrize(
    "text", ["", "not an EDS", "[1000]\nParameterName=x\n", "[1000]\nParameterName=x\nDataType=y"]
)
def test_a_file_that_is_no_eds_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.eds"
    path.write_text(text)
    with pytest.raises(EmulatedEdsError, match=r"bad\.eds"):
        read_eds(path)


def test_a_device_without_controlword_is_no_drive(tmp_path: Path) -> None:
    path = tmp_path / "io.eds"
    path.write_text(
        "[DeviceInfo]\n[1000]\nParameterName=Device type\nDataType=0x0007\nAccessType=ro\n"
    )
    with pytest.raises(EmulatedEdsError, match="controlword"):
        read_eds(path)
