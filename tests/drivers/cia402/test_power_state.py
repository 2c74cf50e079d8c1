"""The power state machine, row by row."""

from itertools import product

import pytest

from drivers.cia402.power_state import (
    Control,
    FaultReset,
    PowerGoal,
    PowerState,
    controlword_towards,
    power_state,
    reached,
)

S = PowerState
G = PowerGoal


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0000, S.NOT_READY),
        (0x0250, S.SWITCH_ON_DISABLED),
        (0x0040, S.SWITCH_ON_DISABLED),
        (0x0070, S.SWITCH_ON_DISABLED),
        (0x0631, S.READY_TO_SWITCH_ON),
        (0x0633, S.SWITCHED_ON),
        (0x1637, S.OPERATION_ENABLED),
        (0x0617, S.QUICK_STOP_ACTIVE),
        (0x021F, S.FAULT_REACTION),
        (0x0208, S.FAULT),
        (0x0238, S.FAULT),
        (0x0001, S.UNKNOWN),
        (0x0025, S.UNKNOWN),
    ],
)
def test_statuswords_tell_states(statusword: int, state: PowerState) -> None:
    assert power_state(statusword) is state


@pytest.mark.parametrize("vendor_bits", [0x0000, 0xFF80, 0x1400])
def test_high_bits_do_not_change_the_state(vendor_bits: int) -> None:
    for low in range(0x80):
        assert power_state(low | vendor_bits) is power_state(low)


# One row per goal, one column per state.
TABLE = {
    G.OFF: dict.fromkeys(S, 0x00),
    G.STANDBY: {
        **dict.fromkeys(S, 0x00),
        S.SWITCH_ON_DISABLED: 0x06,
        S.READY_TO_SWITCH_ON: 0x06,
        S.SWITCHED_ON: 0x06,
        S.OPERATION_ENABLED: 0x06,
    },
    G.ENABLED: {
        **dict.fromkeys(S, 0x00),
        S.SWITCH_ON_DISABLED: 0x06,
        S.READY_TO_SWITCH_ON: 0x07,
        S.SWITCHED_ON: 0x0F,
        S.OPERATION_ENABLED: 0x0F,
        S.QUICK_STOP_ACTIVE: 0x0F,
    },
    G.QUICK_STOP: {
        **dict.fromkeys(S, 0x00),
        S.OPERATION_ENABLED: 0x02,
        S.QUICK_STOP_ACTIVE: 0x02,
        S.UNKNOWN: 0x02,
    },
}


@pytest.mark.parametrize(("goal", "state"), list(product(G, S)))
def test_the_next_controlword_for_every_goal_and_state(goal: PowerGoal, state: PowerState) -> None:
    assert controlword_towards(goal, state) == TABLE[goal][state]


def test_no_goal_resets_a_fault() -> None:
    for goal, state in product(G, S):
        assert not controlword_towards(goal, state) & Control.FAULT_RESET


def test_a_quick_stop_that_is_over_before_it_is_seen_counts_as_done() -> None:
    assert reached(G.QUICK_STOP, S.SWITCH_ON_DISABLED)
    assert reached(G.QUICK_STOP, S.QUICK_STOP_ACTIVE)
    assert not reached(G.QUICK_STOP, S.OPERATION_ENABLED)
    assert not reached(G.QUICK_STOP, S.FAULT_REACTION)
    assert not reached(G.QUICK_STOP, S.UNKNOWN)


def test_only_these_states_have_torque() -> None:
    assert {state for state in S if state.energised} == {
        S.OPERATION_ENABLED,
        S.QUICK_STOP_ACTIVE,
        S.FAULT_REACTION,
    }


def test_of_an_unknown_state_nobody_knows_whether_it_has_torque() -> None:
    with_torque = {state for state in S if state.energised}
    assert {state for state in S if state.unpowered} == set(S) - with_torque - {S.UNKNOWN}


def test_a_fault_reset_is_an_edge_that_two_syncs_can_see() -> None:
    reset = FaultReset()
    reset.begin()
    sent: list[int] = []
    while reset.running:
        sent.append(reset.controlword())
    assert sent == [0x00, 0x00, 0x80, 0x80, 0x00]
