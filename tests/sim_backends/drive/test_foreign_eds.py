"""Drives built from EDS files that are not ours, with what such files have."""

from pathlib import Path

import pytest

from tests.sim_backends.drive.rig import STEPPER, Rig


def changed(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The shipped EDS with something else in it."""
    text = STEPPER.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "other.eds"
    path.write_text(text)
    return path


def section(name: str) -> str:
    """The text of a section of the shipped EDS."""
    text = STEPPER.read_text()
    return text[text.index(f"[{name}]") :].split("\n\n")[0]


def test_a_default_mapping_of_something_that_is_not_there_makes_the_pdo_useless(
    tmp_path: Path,
) -> None:
    old = section("1A00sub1")
    rig = Rig(eds=changed(tmp_path, (old, old.replace("0x60410010", "0x60420010"))))
    rig.operational()
    rig.control(0x06)
    rig.run(1)
    assert rig.frames(0x185) == []
    assert rig.frames(0x285) != []


def test_a_default_cob_id_that_is_none_makes_the_pdo_useless(tmp_path: Path) -> None:
    old = section("1800sub1")
    rig = Rig(eds=changed(tmp_path, (old, old.replace("$NODEID+0x40000180", "0x5FFFFFFF"))))
    rig.operational()
    assert rig.read(0x1800, 1) == 0x5FFFFFFF


@pytest.mark.parametrize(("data_type", "shown"), [("0x0003", -31072), ("0x0007", 100_000)])
def test_an_object_of_another_type_shows_what_fits(
    tmp_path: Path, data_type: str, shown: int
) -> None:
    old = section("6064")
    path = changed(tmp_path, (old, old.replace("DataType=0x0004", f"DataType={data_type}")))
    rig = Rig(eds=path)
    rig.axis.drag_to(100_000.0)
    assert rig.read(0x6064, signed=True) == shown


@pytest.mark.parametrize("index", ["6083", "60C5", "6067", "607F", "6091", "6072"])
def test_what_the_eds_leaves_out_the_drive_has_for_itself(tmp_path: Path, index: str) -> None:
    path = changed(tmp_path, (f"[{index}", f"[5{index[1:]}"))
    rig = Rig(eds=path)
    assert rig.refused(int(index, 16), 0, 1, 4) == 0x06020000
    rig.enable(1)
    rig.set(0x607A, 100)
    rig.control(0x1F)
    rig.run(500)
    assert rig.position == 100


def test_a_type_that_we_do_not_know_is_bytes(tmp_path: Path) -> None:
    old = section("2000")
    rig = Rig(eds=changed(tmp_path, (old, old.replace("DataType=0x0003", "DataType=0x0008"))))
    answer = rig.ask(bytes.fromhex("4000200000000000"))
    assert answer is not None
    assert answer[0] in (0x41, 0x80)
