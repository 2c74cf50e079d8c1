"""The power state machine: every transition of CiA 402, and what it does to the motor."""

import pytest

from tests.sim_backends.drive.rig import Rig

PV, CSP = 3, 8
SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET = (
    0x06,
    0x07,
    0x0F,
    0x00,
    0x02,
    0x80,
)

# The way to each state, by controlwords alone.
WAY = {
    "switch on disabled": (),
    "ready": (SHUTDOWN,),
    "switched on": (SHUTDOWN, SWITCH_ON),
    "enabled": (SHUTDOWN, SWITCH_ON, ENABLE),
    "quick stop": (SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP),
}

# Number, from, controlword, to. 0x605A is 6, so that quick stop active stays.
TRANSITIONS = [
    (2, "switch on disabled", SHUTDOWN, "ready"),
    (3, "ready", SWITCH_ON, "switched on"),
    (4, "switched on", ENABLE, "enabled"),
    (5, "enabled", SWITCH_ON, "switched on"),
    (6, "switched on", SHUTDOWN, "ready"),
    (7, "ready", DISABLE_VOLTAGE, "switch on disabled"),
    (7, "ready", QUICK_STOP, "switch on disabled"),
    (8, "enabled", SHUTDOWN, "ready"),
    (9, "enabled", DISABLE_VOLTAGE, "switch on disabled"),
    (10, "switched on", DISABLE_VOLTAGE, "switch on disabled"),
    (10, "switched on", QUICK_STOP, "switch on disabled"),
    (11, "enabled", QUICK_STOP, "quick stop"),
    (12, "quick stop", DISABLE_VOLTAGE, "switch on disabled"),
    (16, "quick stop", ENABLE, "enabled"),
]

EVERYWHERE = [
    (state, word)
    for state in WAY
    for word in (SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET)
]


def led_to(state: str) -> Rig:
    rig = Rig()
    rig.set(0x605A, 6)
    rig.operational()
    rig.control(*WAY[state])
    assert rig.state == state
    return rig


@pytest.mark.parametrize(("number", "start", "word", "end"), TRANSITIONS)
def test_transitions(number: int, start: str, word: int, end: str) -> None:
    rig = led_to(start)
    rig.control(word)
    assert rig.state == end


@pytest.mark.parametrize(("start", "word"), EVERYWHERE)
def test_every_other_command_changes_nothing(start: str, word: int) -> None:
    ends = {(begin, command): end for _, begin, command, end in TRANSITIONS}
    ends["ready", ENABLE] = "enabled"  # 3 and 4 in one step
    # A fault reset without a fault has the other bits of disable voltage.
    command = DISABLE_VOLTAGE if word == FAULT_RESET else word
    rig = led_to(start)
    rig.control(word)
    assert rig.state == ends.get((start, command), start)


def test_booting_leads_to_switch_on_disabled() -> None:
    """Transitions 0 and 1."""
    rig = Rig(boots=False)
    rig.drive.power_on(0)
    rig.run(100)
    assert rig.axis.power.state.name == "NOT_READY"
    rig.run(300)
    assert rig.state == "switch on disabled"


@pytest.mark.parametrize("start", WAY)
def test_a_fault_leads_from_everywhere_to_fault(start: str) -> None:
    """Transitions 13 and 14."""
    rig = led_to(start)
    rig.fault("emergency=0x2310")
    rig.run(1)
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x2310
    rig.control(*WAY["enabled"])
    assert rig.state == "fault"


def test_a_fault_is_reset_by_a_rising_edge_only() -> None:
    """Transition 15."""
    rig = led_to("enabled")
    rig.control(FAULT_RESET | ENABLE)
    rig.fault("emergency=0x2310")
    rig.control(FAULT_RESET)
    assert rig.state == "fault"
    rig.control(0x00)
    assert rig.state == "fault"
    rig.control(FAULT_RESET)
    assert rig.state == "switch on disabled"
    assert rig.get(0x603F) == 0


def test_a_fault_whose_cause_lasts_cannot_be_reset() -> None:
    rig = Rig()
    rig.fault("over_temperature=100ms")
    rig.control(0x00, FAULT_RESET)
    assert rig.state == "fault"
    rig.run(110)
    rig.control(0x00, FAULT_RESET)
    assert rig.state == "switch on disabled"


def test_the_same_controlword_again_is_obeyed_when_the_state_has_changed() -> None:
    rig = led_to("switched on")
    rig.control(SHUTDOWN)
    rig.fault("emergency=0x2310")
    rig.control(0x00, FAULT_RESET, SHUTDOWN)
    assert rig.state == "ready"


@pytest.mark.parametrize(("state", "energised"), [("switched on", False), ("enabled", True)])
def test_torque_comes_with_operation_enabled(state: str, energised: bool) -> None:
    assert led_to(state).axis.shaft.energised == energised


def test_motion_waits_for_the_brake() -> None:
    rig = Rig(brake_release_s=0.05)
    rig.operational()
    rig.set(0x6060, CSP)
    rig.set(0x60C2, 10, 1)
    rig.control(*WAY["enabled"])
    assert rig.state == "enabled"
    assert not rig.statusword & 1 << 12
    rig.set(0x607A, 500)
    rig.run(45)
    assert rig.position == 0
    rig.run(10)
    assert rig.statusword & 1 << 12
    rig.set(0x607A, 500)
    rig.run(100)
    assert rig.position == 500


def turning() -> Rig:
    """An enabled drive at 20000/s; its ramps: 0x6084 100000, 0x6085 400000."""
    rig = Rig()
    rig.set(0x605A, 6)
    rig.set(0x6083, 1_000_000)
    rig.set(0x6084, 100_000)
    rig.set(0x6085, 400_000)
    rig.set(0x60C6, 1_000_000)
    rig.enable(PV)
    rig.set(0x60FF, 20_000)
    rig.run(200)
    assert rig.get(0x606C) == pytest.approx(20_000, abs=20)
    return rig


SLOW_MS, QUICK_MS, HARD_MS, NOW_MS = 200.0, 50.0, 20.0, 0.0


def stopping_ms(rig: Rig) -> float:
    """How long the demand goes on."""
    for passed in range(1000):
        if rig.get(0x606B) == 0:
            return float(passed)
        rig.run(1)
    raise AssertionError("does not stop")


@pytest.mark.parametrize(
    ("index", "option", "word", "lasts_ms", "end"),
    [
        (0x605A, 0, QUICK_STOP, NOW_MS, "switch on disabled"),
        (0x605A, 1, QUICK_STOP, SLOW_MS, "switch on disabled"),
        (0x605A, 2, QUICK_STOP, QUICK_MS, "switch on disabled"),
        (0x605A, 3, QUICK_STOP, HARD_MS, "switch on disabled"),
        (0x605A, 5, QUICK_STOP, SLOW_MS, "quick stop"),
        (0x605A, 6, QUICK_STOP, QUICK_MS, "quick stop"),
        (0x605A, 7, QUICK_STOP, HARD_MS, "quick stop"),
        (0x605B, 0, SHUTDOWN, NOW_MS, "ready"),
        (0x605B, 1, SHUTDOWN, SLOW_MS, "ready"),
        (0x605C, 0, SWITCH_ON, NOW_MS, "switched on"),
        (0x605C, 1, SWITCH_ON, SLOW_MS, "switched on"),
        (0x605D, 1, ENABLE | 0x100, SLOW_MS, "enabled"),
        (0x605D, 2, ENABLE | 0x100, QUICK_MS, "enabled"),
    ],
)
def test_ways_of_stopping(index: int, option: int, word: int, lasts_ms: float, end: str) -> None:
    rig = turning()
    rig.set(index, option)
    rig.control(word)
    assert stopping_ms(rig) == pytest.approx(lasts_ms, abs=2)
    rig.run(60)
    assert rig.state == end
    assert rig.get(0x606C) == 0


@pytest.mark.parametrize(("option", "lasts_ms"), [(0, NOW_MS), (1, SLOW_MS), (2, QUICK_MS)])
def test_fault_reactions(option: int, lasts_ms: float) -> None:
    rig = turning()
    rig.set(0x605E, option)
    rig.fault("emergency=0x2310")
    assert rig.state == ("fault reaction" if option else "fault")
    assert stopping_ms(rig) == pytest.approx(lasts_ms, abs=2)
    rig.run(30)
    assert rig.state == "fault"
    assert not rig.axis.shaft.energised


@pytest.mark.parametrize(
    ("index", "value"),
    [(0x605A, 4), (0x605A, 8), (0x605B, 2), (0x605C, -1), (0x605D, 0), (0x605E, 3), (0x6007, 4)],
)
def test_options_that_this_drive_does_not_have(index: int, value: int) -> None:
    assert Rig().refused(index, 0, value) in (0x06090030, 0x06090031, 0x06090032)


@pytest.mark.parametrize("option", [0, 1, 2, 3])
def test_from_a_quick_stop_that_ends_in_switch_on_disabled_there_is_no_way_back(
    option: int,
) -> None:
    rig = turning()
    rig.set(0x605A, option)
    rig.control(QUICK_STOP, ENABLE)
    assert rig.state == ("quick stop" if option else "switch on disabled")


def test_disabling_can_be_taken_back_while_it_brakes() -> None:
    rig = turning()
    rig.control(SWITCH_ON)
    rig.run(100)
    assert rig.state == "enabled"
    assert rig.get(0x606C) < 15_000
    rig.control(ENABLE)
    rig.run(200)
    assert rig.state == "enabled"
    assert rig.get(0x606C) == pytest.approx(20_000, abs=20)


def test_halt_keeps_the_drive_enabled_and_its_end_resumes() -> None:
    rig = turning()
    rig.control(ENABLE | 0x100)
    rig.run(300)
    assert rig.state == "enabled"
    assert rig.statusword & 1 << 10
    rig.control(ENABLE)
    rig.run(300)
    assert rig.get(0x606C) == pytest.approx(20_000, abs=20)


def test_a_drive_enabled_with_halt_does_not_move() -> None:
    rig = Rig()
    rig.operational()
    rig.set(0x6060, PV)
    rig.set(0x60FF, 20_000)
    rig.control(SHUTDOWN, SWITCH_ON, ENABLE | 0x100)
    rig.run(500)
    assert rig.position == 0
    rig.control(ENABLE)
    rig.run(500)
    assert rig.position > 1000


def test_enabling_is_bumpless() -> None:
    """Where the shaft was turned by hand, it is held; an old target does not pull it back."""
    rig = Rig()
    rig.set(0x607A, 0)
    assert rig.axis.drag_to(4321.0)
    rig.enable(CSP)
    rig.run(500)
    assert rig.position == 4321


@pytest.mark.parametrize(("state", "bits"), [("enabled", 1 << 4 | 1 << 9)])
def test_voltage_and_remote_show(state: str, bits: int) -> None:
    assert led_to(state).statusword & bits == bits
