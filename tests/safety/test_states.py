"""Every state, with every request, at every severity: where the robot goes."""

from itertools import product

import pytest

from safety.causes import Severity
from safety.states import OperatingState, Request, next_state, refusal

STANDBY, READY, ARMED, RUNNING, HOLD, FAULT, ESTOP, HOMING = OperatingState
ARM, ARMED_, DISARM, START, FINISHED, HOLD_, RESUME, STOP, CLEAR, HOME, HOMED = Request
COLUMNS = [None, *Request]
# One letter per request; the state that the robot goes to. S standby, D ready, A armed, R running,
# H hold, F fault, E estop, Z homing. "-": no request.
LETTERS = dict(zip("SDARHFEZ", OperatingState, strict=True))
TABLE = """
state    severity           -  arm armed disarm start finished hold resume stop clear home homed
STANDBY  NONE               D   D    D     D     D      D      D     D     D     D     Z    D
STANDBY  WARNING            D   D    D     D     D      D      D     D     D     D     Z    D
STANDBY  NOT_READY          S   S    S     S     S      S      S     S     S     S     S    S
STANDBY  HOLD               S   S    S     S     S      S      S     S     S     S     S    S
STANDBY  DISARM             S   S    S     S     S      S      S     S     S     S     S    S
STANDBY  FAULT              S   S    S     S     S      S      S     S     S     S     S    S
STANDBY  ESTOP              S   S    S     S     S      S      S     S     S     S     S    S
READY    NONE               D   D    A     D     D      D      D     D     D     D     Z    D
READY    WARNING            D   D    A     D     D      D      D     D     D     D     Z    D
READY    NOT_READY          S   S    S     S     S      S      S     S     S     S     S    S
READY    HOLD               S   S    S     S     S      S      S     S     S     S     S    S
READY    DISARM             S   S    S     S     S      S      S     S     S     S     S    S
READY    FAULT              S   S    S     S     S      S      S     S     S     S     S    S
READY    ESTOP              S   S    S     S     S      S      S     S     S     S     S    S
ARMED    NONE               A   A    A     S     R      A      A     R     S     A     A    A
ARMED    WARNING            A   A    A     S     R      A      A     R     S     A     A    A
ARMED    NOT_READY          A   A    A     S     R      A      A     R     S     A     A    A
ARMED    HOLD               A   A    A     S     A      A      A     A     S     A     A    A
ARMED    DISARM             S   S    S     S     S      S      S     S     S     S     S    S
ARMED    FAULT              F   F    F     F     F      F      F     F     F     F     F    F
ARMED    ESTOP              E   E    E     E     E      E      E     E     E     E     E    E
RUNNING  NONE               R   R    R     S     R      A      H     R     S     R     R    R
RUNNING  WARNING            R   R    R     S     R      A      H     R     S     R     R    R
RUNNING  NOT_READY          R   R    R     S     R      A      H     R     S     R     R    R
RUNNING  HOLD               H   H    H     S     H      H      H     H     S     H     H    H
RUNNING  DISARM             S   S    S     S     S      S      S     S     S     S     S    S
RUNNING  FAULT              F   F    F     F     F      F      F     F     F     F     F    F
RUNNING  ESTOP              E   E    E     E     E      E      E     E     E     E     E    E
HOLD     NONE               A   A    A     S     A      A      A     R     S     A     A    A
HOLD     WARNING            A   A    A     S     A      A      A     R     S     A     A    A
HOLD     NOT_READY          A   A    A     S     A      A      A     R     S     A     A    A
HOLD     HOLD               H   H    H     S     H      H      H     H     S     H     H    H
HOLD     DISARM             S   S    S     S     S      S      S     S     S     S     S    S
HOLD     FAULT              F   F    F     F     F      F      F     F     F     F     F    F
HOLD     ESTOP              E   E    E     E     E      E      E     E     E     E     E    E
FAULT    NONE               F   F    F     F     F      F      F     F     F     S     F    F
FAULT    WARNING            F   F    F     F     F      F      F     F     F     S     F    F
FAULT    NOT_READY          F   F    F     F     F      F      F     F     F     S     F    F
FAULT    HOLD               F   F    F     F     F      F      F     F     F     S     F    F
FAULT    DISARM             F   F    F     F     F      F      F     F     F     S     F    F
FAULT    FAULT              F   F    F     F     F      F      F     F     F     F     F    F
FAULT    ESTOP              F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    NONE               F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    WARNING            F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    NOT_READY          F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    HOLD               F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    DISARM             F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    FAULT              F   F    F     F     F      F      F     F     F     F     F    F
ESTOP    ESTOP              E   E    E     E     E      E      E     E     E     E     E    E
HOMING   NONE               Z   Z    Z     S     Z      Z      S     Z     S     Z     Z    S
HOMING   WARNING            Z   Z    Z     S     Z      Z      S     Z     S     Z     Z    S
HOMING   NOT_READY          Z   Z    Z     S     Z      Z      S     Z     S     Z     Z    S
HOMING   HOLD               S   S    S     S     S      S      S     S     S     S     S    S
HOMING   DISARM             S   S    S     S     S      S      S     S     S     S     S    S
HOMING   FAULT              F   F    F     F     F      F      F     F     F     F     F    F
HOMING   ESTOP              E   E    E     E     E      E      E     E     E     E     E    E
"""
ROWS = [
    (OperatingState[line.split()[0]], Severity[line.split()[1]], line.split()[2:])
    for line in TABLE.strip().splitlines()[1:]
]
FOLLOWS = (ARMED, RUNNING, HOLD)
ENERGISED = (*FOLLOWS, HOMING)


def go(state: OperatingState, request: Request | None, severity: Severity) -> OperatingState:
    return next_state(state, request, severity, severity >= Severity.NOT_READY)


def test_the_table_is_whole() -> None:
    assert [row[:2] for row in ROWS] == list(product(OperatingState, Severity))
    assert all(len(row[2]) == len(COLUMNS) for row in ROWS)
    heading = TABLE.strip().splitlines()[0].split()[2:]
    assert heading == ["-", *(request.value for request in Request)]


@pytest.mark.parametrize(
    ("state", "severity", "letters"), ROWS, ids=[f"{row[0].name}-{row[1].name}" for row in ROWS]
)
def test_where_the_robot_goes(
    state: OperatingState, severity: Severity, letters: list[str]
) -> None:
    assert [go(state, request, severity) for request in COLUMNS] == [
        LETTERS[letter] for letter in letters
    ]


def test_what_is_energised() -> None:
    assert [state for state in OperatingState if state.energised] == list(ENERGISED)
    assert [state for state in OperatingState if state.follows] == list(FOLLOWS)


def test_power_comes_on_only_by_drives_that_were_asked_for_in_ready() -> None:
    for state, request, severity in product(OperatingState, COLUMNS, Severity):
        if not state.energised and go(state, request, severity).energised:
            assert (state, request) in ((READY, ARMED_), (STANDBY, HOME), (READY, HOME))
            assert severity < Severity.NOT_READY


def test_the_state_in_words_is_its_name() -> None:
    assert all(state.value == state.name.lower() for state in OperatingState)


# Refusals.


@pytest.mark.parametrize("request_", [STOP, DISARM])
def test_a_stop_is_never_refused(request_: Request) -> None:
    for state, severity, blocked in product(OperatingState, Severity, (False, True)):
        assert refusal(state, request_, severity, blocked) == ""


DOES = {
    (ARMED_, READY): ARMED,
    (START, ARMED): RUNNING,
    (FINISHED, RUNNING): ARMED,
    (RESUME, ARMED): RUNNING,
    (RESUME, HOLD): RUNNING,
    (CLEAR, FAULT): STANDBY,
    (HOME, STANDBY): HOMING,
    (HOME, READY): HOMING,
    (HOMED, HOMING): STANDBY,
    (HOLD_, HOMING): STANDBY,
}


@pytest.mark.parametrize(("request_", "state"), DOES, ids=lambda one: one.name)
@pytest.mark.parametrize("severity", [s for s in Severity if s < Severity.DISARM])
def test_what_is_not_refused_happens_and_what_is_refused_does_not(
    request_: Request, state: OperatingState, severity: Severity
) -> None:
    refused = refusal(state, request_, severity, severity >= Severity.NOT_READY)
    happens = go(state, request_, severity) is DOES[request_, state]
    assert happens is (not refused) or request_ is FINISHED


@pytest.mark.parametrize(
    ("state", "request_", "severity", "words"),
    [
        (STANDBY, ARM, Severity.NONE, "something is not ready"),
        (STANDBY, START, Severity.NONE, "something is not ready"),
        (READY, ARM, Severity.NONE, ""),
        (READY, ARM, Severity.WARNING, ""),
        (READY, ARM, Severity.NOT_READY, "something is not ready"),
        (READY, ARMED_, Severity.NOT_READY, "something is not ready"),
        (READY, START, Severity.NONE, "arm first"),
        (READY, RESUME, Severity.NONE, "arm first"),
        (READY, HOLD_, Severity.NONE, "arm first"),
        (ARMED, ARM, Severity.NONE, "the drives are on"),
        (ARMED, START, Severity.NOT_READY, ""),
        (ARMED, START, Severity.HOLD, "keeps the robot from moving"),
        (ARMED, RESUME, Severity.HOLD, "keeps the robot from moving"),
        (ARMED, RESUME, Severity.NONE, ""),
        (ARMED, HOLD_, Severity.NONE, "nothing moves"),
        (ARMED, CLEAR, Severity.NONE, "nothing moves"),
        (ARMED, FINISHED, Severity.NONE, "nothing moves"),
        (RUNNING, START, Severity.NONE, "the robot is moving"),
        (RUNNING, RESUME, Severity.NONE, "the robot is moving"),
        (RUNNING, HOLD_, Severity.HOLD, ""),
        (RUNNING, HOLD_, Severity.FAULT, ""),
        (RUNNING, FINISHED, Severity.NONE, ""),
        (HOLD, START, Severity.NONE, "resume or stop"),
        (HOLD, HOLD_, Severity.HOLD, ""),
        (HOLD, RESUME, Severity.NOT_READY, ""),
        (HOLD, RESUME, Severity.HOLD, "keeps the robot from moving"),
        (FAULT, ARM, Severity.FAULT, "then clear"),
        (FAULT, CLEAR, Severity.DISARM, ""),
        (FAULT, CLEAR, Severity.FAULT, "still there"),
        (STANDBY, CLEAR, Severity.NOT_READY, ""),
        (STANDBY, CLEAR, Severity.FAULT, "still there"),
        (READY, CLEAR, Severity.NONE, ""),
        (ESTOP, CLEAR, Severity.ESTOP, "external chain is open"),
        (ESTOP, ARM, Severity.ESTOP, "external chain is open"),
    ],
)
def test_a_refusal_says_why(
    state: OperatingState, request_: Request, severity: Severity, words: str
) -> None:
    said = refusal(state, request_, severity, severity >= Severity.NOT_READY)
    assert (words in said) if words else said == ""


@pytest.mark.parametrize("state", OperatingState)
def test_a_fault_while_the_drives_come_to_rest_counts_as_one_before(state: OperatingState) -> None:
    for severity, request in product(Severity, COLUMNS):
        still = next_state(state, request, severity, True)
        if state is STANDBY and severity >= Severity.FAULT:
            still = ESTOP if severity is Severity.ESTOP else FAULT
        found = next_state(state, request, severity, True, coming_to_rest=True)
        assert found is still, (severity, request)
