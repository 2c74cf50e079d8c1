"""What devices say, as a hand's motions."""

import pytest

from daemon.steering.devices import MOTIONS, PROFILES, DeviceState
from daemon.steering.input_events import EV_ABS, EV_KEY, EV_REL, InputEvent, Report

S = 1_000_000_000


def told(profile: str, *events: InputEvent, t_ns: int = 0) -> DeviceState:
    state = DeviceState(PROFILES[profile])
    state.take(Report(events), t_ns)
    return state


@pytest.mark.parametrize("kind", [EV_REL, EV_ABS])
@pytest.mark.parametrize(
    ("code", "counts", "motion", "rate"),
    [
        (0, 350, "x", 1.0),
        (1, 350, "y", -1.0),
        (2, -350, "z", 1.0),
        (3, 350, "about_x", 1.0),
        (4, 350, "about_y", -1.0),
        (5, -350, "about_z", 1.0),
        (0, 3000, "x", 1.0),
    ],
)
def test_a_3d_mouse_is_pushed_and_turned_all_six_ways(
    kind: int, code: int, counts: int, motion: str, rate: float
) -> None:
    rates = told("3d_mouse", InputEvent(kind, code, counts)).rates(0)
    assert rates[MOTIONS.index(motion)] == pytest.approx(rate)
    assert sum(map(abs, rates)) == pytest.approx(1.0)


def test_a_relative_rate_that_is_not_told_again_is_over() -> None:
    state = told("3d_mouse", InputEvent(EV_REL, 0, 350))
    assert state.rates(S // 10)[0] == 1.0
    assert state.rates(S // 5)[0] == 0.0


def test_an_absolute_rate_lasts_until_another_is_told() -> None:
    state = told("gamepad", InputEvent(EV_ABS, 0, 32767))
    assert state.rates(60 * S)[0] == 1.0
    state.take(Report((InputEvent(EV_ABS, 0, 0),)), 61 * S)
    assert state.rates(61 * S)[0] == 0.0


def test_what_is_pushed_a_little_is_not_pushed() -> None:
    for counts, rate in ((20, 0.0), (-20, 0.0), (185, 0.4986), (-185, -0.4986)):
        found = told("3d_mouse", InputEvent(EV_REL, 0, counts)).rates(0)[0]
        assert found == pytest.approx(rate, abs=1e-3)


def test_a_device_states_its_own_ranges() -> None:
    profile = PROFILES["gamepad"].ranged({0: (0.0, 255.0), 1: (-128.0, 127.0), 5: (0.0, 1023.0)})
    state = DeviceState(profile)
    events = InputEvent(EV_ABS, 0, 255), InputEvent(EV_ABS, 1, 127), InputEvent(EV_ABS, 5, 1023)
    state.take(Report(events), 0)
    assert state.rates(0)[:3] == (1.0, -1.0, 1.0)
    state.take(Report((InputEvent(EV_ABS, 0, 128), InputEvent(EV_ABS, 5, 0))), 0)
    assert state.rates(0)[0] == 0.0
    assert state.rates(0)[2] == 0.0


def test_both_triggers_together_lead_nowhere() -> None:
    events = InputEvent(EV_ABS, 2, 255), InputEvent(EV_ABS, 5, 255)
    assert told("gamepad", *events).rates(0)[2] == 0.0


def test_a_mouse_tells_how_far_it_was_moved_and_is_never_pushed() -> None:
    state = DeviceState(PROFILES["mouse"])
    report = Report((InputEvent(EV_REL, 0, 400), InputEvent(EV_REL, 1, 400)))
    moved = state.take(report, 0)
    assert moved[:2] == pytest.approx((25.4, -25.4))
    assert state.rates(0) == (0.0,) * 6


@pytest.mark.parametrize(
    ("profile", "dead_man", "clutch"),
    [("3d_mouse", 0x100, 0x101), ("gamepad", 0x137, 0x136), ("mouse", 0x110, 0x111)],
)
def test_keys_count_while_they_are_held(profile: str, dead_man: int, clutch: int) -> None:
    state = told(profile, InputEvent(EV_KEY, dead_man, 1), InputEvent(EV_KEY, clutch, 1))
    assert (state.dead_man, state.clutch) == (True, True)
    state.take(Report((InputEvent(EV_KEY, dead_man, 2), InputEvent(EV_KEY, clutch, 0))), 0)
    assert (state.dead_man, state.clutch) == (True, False)
    state.take(Report((InputEvent(EV_KEY, dead_man, 0),)), 0)
    assert not state.dead_man


def test_of_a_report_with_events_lost_no_key_counts_as_held_and_no_way_as_gone() -> None:
    state = DeviceState(PROFILES["mouse"])
    left = (InputEvent(EV_KEY, 0x110, 1), InputEvent(EV_REL, 0, 400))
    assert state.take(Report(left, lost=True), 0) == (0.0,) * 6
    assert not state.dead_man
    assert state.take(Report(left), 0)[0] > 0.0
    assert state.dead_man


def test_where_events_were_lost_everything_counts_as_let_go() -> None:
    events = InputEvent(EV_KEY, 0x137, 1), InputEvent(EV_ABS, 0, 32767)
    state = told("gamepad", *events)
    state.take(Report((), lost=True), 0)
    assert not state.dead_man
    assert state.rates(0) == (0.0,) * 6


def test_keys_and_axes_that_mean_nothing_do_nothing() -> None:
    state = told("mouse", InputEvent(EV_KEY, 0x2FF, 1), InputEvent(EV_ABS, 0x3F, 1))
    assert (state.dead_man, state.clutch) == (False, False)
    assert state.rates(0) == (0.0,) * 6
