"""The grammar of faults, and the answers to what does not fit it."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import pytest

from config.loader import load_robot
from daemon.host.clock import MonotonicClock
from sim_backends.faults import FOREVER_S, FaultError, FaultKind, Parameter, Value, understand
from sim_backends.lab.lab import Lab

SOFT_ARM = Path(str(files("config"))) / "robots" / "soft_arm.yaml"
KINDS = (
    FaultKind("missing", "no pose", (Parameter("for_s", "duration_s", 1.0),)),
    FaultKind("bad_crc", "wrong CRC", (Parameter("replies", "count"),)),
    FaultKind("emergency", "EMCY", (Parameter("code", "code"), Parameter("gain", "number", 1.5))),
    FaultKind("unplug", "no more", (Parameter("tool", "word", "tip"),)),
    FaultKind("reset", "restarts"),
)


class Device:
    faults = KINDS

    def __init__(self) -> None:
        self.told: list[tuple[str, dict[str, Value], int]] = []

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        self.told.append((fault, dict(arguments), t_ns))


@pytest.mark.parametrize(
    ("order", "fault", "arguments"),
    [
        ("tracker.missing=0.5s", "missing", {"for_s": 0.5}),
        ("tracker.missing=200ms", "missing", {"for_s": 0.2}),
        ("tracker.missing=2min", "missing", {"for_s": 120.0}),
        ("tracker.missing=3", "missing", {"for_s": 3.0}),
        ("tracker.missing=forever", "missing", {"for_s": FOREVER_S}),
        ("tracker.missing", "missing", {"for_s": 1.0}),
        ("tracker.bad_crc=3", "bad_crc", {"replies": 3}),
        (" tracker.emergency=0x8611 , 2 ", "emergency", {"code": 0x8611, "gain": 2.0}),
        ("tracker.unplug", "unplug", {"tool": "tip"}),
        ("tracker.reset", "reset", {}),
    ],
)
def test_orders_reach_the_device_with_their_values(
    order: str, fault: str, arguments: dict[str, Value]
) -> None:
    device = Device()
    understand({"tracker": device}, order).carry_out(7)
    assert device.told == [(fault, arguments, 7)]


def test_a_target_may_have_dots_and_slashes() -> None:
    device = Device()
    understand({"drive.can0/3": device}, "drive.can0/3.reset").carry_out(0)
    assert device.told


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ("traker.reset", "there is no device 'traker' (did you mean 'tracker'?)"),
        ("reset", "'reset' is not of the form DEVICE.FAULT, such as tracker.missing=3s"),
        ("tracker.misssing", "has no fault 'misssing' (did you mean 'missing'?)"),
        ("tracker.zzz", "it has: bad_crc, emergency, missing, reset, unplug"),
        ("tracker.missing=soon", "for_s: 'soon' is not like 0.5s, 200ms or forever"),
        ("tracker.bad_crc", "bad_crc needs replies: bad_crc=REPLIES"),
        ("tracker.bad_crc=-1", "replies: '-1' is not like 3"),
        ("tracker.emergency=x", "code: 'x' is not like 0x8611"),
        ("tracker.reset=1", "reset takes 0 values"),
    ],
)
def test_what_does_not_fit_is_answered_with_what_would(order: str, says: str) -> None:
    device = Device()
    with pytest.raises(FaultError) as error:
        understand({"tracker": device}, order)
    assert says in str(error.value)
    assert device.told == []


def test_of_several_orders_none_is_carried_out_where_one_is_not_understood() -> None:
    lab = Lab(load_robot(SOFT_ARM).robot, SOFT_ARM, MonotonicClock())
    with pytest.raises(FaultError, match="no fault 'mising'"):
        lab.inject("tracker.missing=1s", "tracker.mising=1s")
    assert not lab.diary.after(0)
    lab.inject("tracker.missing=1s", "bus.can0.off")
    assert [text for _, text in lab.diary.after(0)] == ["tracker.missing=1s", "bus.can0.off"]
