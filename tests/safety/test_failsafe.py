"""What conditions amount to: debounce, latching, and who comes first."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.causes import Cause, CauseRow, ClearRule, Severity
from safety.failsafe import Failsafe, Verdict
from safety.states import OperatingState, Request, next_state
from tests.safety.examples import examples

MS = 1_000_000


class Example(CauseRow):
    """A table of causes that nothing here depends on but their severities and rules."""

    WARNING = "warning", Severity.WARNING, 0.0, ClearRule.BY_ITSELF, "what it means", "what helps"
    SLOW = "slow", Severity.HOLD, 0.1, ClearRule.BY_ITSELF, "what it means", "what helps"
    HELD = "held", Severity.HOLD, 0.0, ClearRule.BY_RESUME, "what it means", "what helps"
    FAULT = "fault", Severity.FAULT, 0.0, ClearRule.DELIBERATELY, "what it means", "what helps"
    OTHER_FAULT = "other_fault", Severity.FAULT, 0.0, ClearRule.DELIBERATELY, "this", "that"
    SLOW_FAULT = "slow_fault", Severity.FAULT, 0.1, ClearRule.DELIBERATELY, "this", "that"
    SLOW_HELD = "slow_held", Severity.HOLD, 0.1, ClearRule.BY_RESUME, "this", "that"
    CHAIN = "chain", Severity.ESTOP, 0.0, ClearRule.DELIBERATELY, "this", "that"


(WARNING, SLOW, HELD, FAULT, OTHER_FAULT, SLOW_FAULT, SLOW_HELD, CHAIN) = Example


@pytest.fixture
def failsafe() -> Failsafe:
    return Failsafe()


def names(verdict: Verdict) -> list[str]:
    return [reason.cause.value for reason in verdict.reasons]


def test_without_a_condition_all_is_well(failsafe: Failsafe) -> None:
    verdict = failsafe.evaluate(0, True)
    assert (verdict.severity, verdict.reasons) == (Severity.NONE, ())


def test_a_condition_that_was_never_there_may_be_absent(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, False, 0)
    assert not failsafe._watches
    assert failsafe.evaluate(0, True).reasons == ()


def test_it_may_be_absent_beside_one_that_is_there_too(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 0)
    failsafe.set(HELD, False, 0)
    failsafe.set(FAULT, False, 0, "another subject")
    assert list(failsafe._watches) == [("fault", "")]
    assert names(failsafe.evaluate(0, True)) == ["fault"]


def test_it_watches_from_the_first_condition_until_the_last_is_forgotten(
    failsafe: Failsafe,
) -> None:
    watching = [failsafe.watching]
    for present in (False, True, False):
        failsafe.set(HELD, present, 0)
        watching.append(failsafe.watching)
    for t_ns in (1, 2):
        failsafe.evaluate(t_ns, False)
        watching.append(failsafe.watching)
    # What has come and gone is watched until a verdict has had it, and another one has not.
    assert watching == [False, False, True, True, True, False]


def test_the_shipped_table_is_the_default() -> None:
    failsafe = Failsafe()
    failsafe.set(Cause.DISK_LOW, True, 0)
    assert failsafe.evaluate(0, False).severity is Severity.NOT_READY


def test_a_reason_tells_all_about_itself(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 5, "can0/3", "code 0x8611")
    (reason,) = failsafe.evaluate(9, True).reasons
    assert reason.cause is FAULT
    assert (reason.subject, reason.detail, reason.since_ns) == ("can0/3", "code 0x8611", 5)
    assert reason.severity is Severity.FAULT
    assert not reason.latched


def test_by_itself_goes_with_its_condition(failsafe: Failsafe) -> None:
    failsafe.set(WARNING, True, 0)
    assert names(failsafe.evaluate(1, True)) == ["warning"]
    failsafe.set(WARNING, False, 2)
    assert names(failsafe.evaluate(2, True)) == []


# Who comes first.


def test_the_worst_comes_first_and_among_equals_the_oldest(failsafe: Failsafe) -> None:
    failsafe.set(WARNING, True, 0)
    failsafe.set(OTHER_FAULT, True, 1)
    failsafe.set(FAULT, True, 2)
    failsafe.set(HELD, True, 1)
    verdict = failsafe.evaluate(3, True)
    assert names(verdict) == ["other_fault", "fault", "held", "warning"]
    assert verdict.severity is Severity.FAULT
    assert [one.cause.value for one in verdict.at_least(Severity.HOLD)] == [
        "other_fault",
        "fault",
        "held",
    ]


def test_what_came_at_once_is_in_alphabetical_order(failsafe: Failsafe) -> None:
    for name, subject in ((OTHER_FAULT, "a"), (FAULT, "b"), (FAULT, "a")):
        failsafe.set(name, True, 0, subject)
    reasons = failsafe.evaluate(0, True).reasons
    assert [(one.cause.value, one.subject) for one in reasons] == [
        ("fault", "a"),
        ("fault", "b"),
        ("other_fault", "a"),
    ]


def test_each_subject_has_its_own_reason(failsafe: Failsafe) -> None:
    failsafe.set(WARNING, True, 0, "can0/1")
    failsafe.set(WARNING, True, 1, "can0/2")
    assert len(failsafe.evaluate(1, True).reasons) == 2
    failsafe.set(WARNING, False, 2, "can0/1")
    (reason,) = failsafe.evaluate(3, True).reasons
    assert (reason.subject, reason.since_ns) == ("can0/2", 1)


# Time.


def test_a_condition_must_hold_for_its_debounce(failsafe: Failsafe) -> None:
    failsafe.set(SLOW, True, 0)
    assert names(failsafe.evaluate(100 * MS - 1, True)) == []
    assert names(failsafe.evaluate(100 * MS, True)) == ["slow"]
    assert failsafe.evaluate(100 * MS, True).reasons[0].since_ns == 0


def test_debounce_also_runs_between_two_sets(failsafe: Failsafe) -> None:
    failsafe.set(SLOW, True, 0)
    failsafe.set(SLOW, True, 60 * MS)
    failsafe.set(SLOW, True, 120 * MS)
    failsafe.set(SLOW, False, 120 * MS)
    (reason,) = failsafe.evaluate(120 * MS, True).reasons
    assert reason.since_ns == 0
    assert names(failsafe.evaluate(120 * MS, True)) == []


def test_what_comes_and_goes_between_two_verdicts_is_in_the_next(failsafe: Failsafe) -> None:
    failsafe.set(WARNING, True, 1)
    failsafe.set(WARNING, False, 1)
    (reason,) = failsafe.evaluate(2, True).reasons
    assert not reason.latched
    assert names(failsafe.evaluate(3, True)) == []


def flap(failsafe: Failsafe, present_ms: int, absent_ms: int, for_ms: int) -> bool:
    """Whether `slow` fires while it comes and goes."""
    t_ns = 0
    while t_ns < for_ms * MS:
        failsafe.set(SLOW, True, t_ns)
        if failsafe.evaluate(t_ns + present_ms * MS, True).reasons:
            return True
        t_ns += present_ms * MS
        failsafe.set(SLOW, False, t_ns)
        t_ns += absent_ms * MS
        failsafe.evaluate(t_ns, True)
    return False


def test_a_condition_that_flaps_still_fires(failsafe: Failsafe) -> None:
    assert flap(failsafe, present_ms=30, absent_ms=70, for_ms=1500)


def test_a_condition_that_is_there_for_moments_only_does_not_fire(failsafe: Failsafe) -> None:
    assert not flap(failsafe, present_ms=15, absent_ms=85, for_ms=3000)


def test_a_fired_condition_that_flaps_fires_sooner_again(failsafe: Failsafe) -> None:
    failsafe.set(SLOW, True, 0)
    failsafe.evaluate(500 * MS, True)
    failsafe.set(SLOW, False, 500 * MS)
    assert names(failsafe.evaluate(540 * MS, True)) == []
    failsafe.set(SLOW, True, 540 * MS)
    assert names(failsafe.evaluate(550 * MS - 1, True)) == []
    (reason,) = failsafe.evaluate(550 * MS, True).reasons
    assert reason.since_ns == 540 * MS


def test_after_a_long_absence_all_is_forgotten(failsafe: Failsafe) -> None:
    failsafe.set(SLOW, True, 0)
    failsafe.set(SLOW, False, 99 * MS)
    failsafe.evaluate(495 * MS, True)
    failsafe.set(SLOW, True, 1000 * MS)
    assert names(failsafe.evaluate(1100 * MS - 1, True)) == []
    assert names(failsafe.evaluate(1100 * MS, True)) == ["slow"]
    failsafe.set(SLOW, False, 1100 * MS)
    failsafe.evaluate(1100 * MS, True)
    failsafe.evaluate(1500 * MS, True)
    assert not failsafe._watches


def test_a_time_that_goes_backwards_changes_nothing(failsafe: Failsafe) -> None:
    failsafe.set(SLOW, True, 100 * MS)
    assert names(failsafe.evaluate(0, True)) == []
    assert names(failsafe.evaluate(200 * MS - 1, True)) == []
    assert names(failsafe.evaluate(200 * MS, True)) == ["slow"]


@examples(60)
@given(
    share=st.integers(1, 99),
    period_ms=st.integers(2, 60),
)
def test_it_fires_if_it_is_present_more_than_a_fifth_of_the_time(
    share: int, period_ms: int
) -> None:
    failsafe = Failsafe()
    fired = False
    present_ns = period_ms * MS * share // 100
    for number in range(6_000 // period_ms):
        failsafe.set(SLOW, True, number * period_ms * MS)
        failsafe.set(SLOW, False, number * period_ms * MS + present_ns)
        fired = fired or bool(failsafe.evaluate((number + 1) * period_ms * MS, True).reasons)
    if share > 22:
        assert fired
    elif share < 20:
        assert not fired


# Latching.


def test_a_fault_that_came_while_energised_stays_until_it_is_cleared(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1, "can0/3", "code 1")
    failsafe.evaluate(2, True)
    failsafe.set(FAULT, False, 3, "can0/3")
    (reason,) = failsafe.evaluate(4, False).reasons
    assert reason.latched
    assert reason.severity is Severity.FAULT
    assert (reason.since_ns, reason.detail) == (1, "code 1")
    failsafe.resume()
    assert names(failsafe.evaluate(5, False)) == ["fault"]
    assert failsafe.clear() == ()
    assert names(failsafe.evaluate(6, False)) == []


def test_a_fault_that_came_and_went_between_two_verdicts_is_latched(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1)
    failsafe.set(FAULT, False, 1)
    assert failsafe.clear() == ()
    (reason,) = failsafe.evaluate(2, True).reasons
    assert reason.latched
    failsafe.set(FAULT, True, 3)
    failsafe.set(FAULT, False, 3)
    failsafe.clear()
    assert names(failsafe.evaluate(4, True)) == ["fault"], "the second one nobody has seen yet"


def test_a_fault_in_standby_blocks_and_goes_by_itself(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1)
    verdict = failsafe.evaluate(2, False)
    assert verdict.severity is Severity.FAULT
    failsafe.set(FAULT, False, 3)
    assert names(failsafe.evaluate(4, False)) == []


def test_a_fault_that_fires_only_after_the_power_is_off_goes_by_itself(
    failsafe: Failsafe,
) -> None:
    failsafe.set(SLOW_FAULT, True, 0)
    assert names(failsafe.evaluate(50 * MS, True)) == []
    assert names(failsafe.evaluate(100 * MS, False)) == ["slow_fault"]
    assert len(failsafe.clear()) == 1
    failsafe.set(SLOW_FAULT, False, 101 * MS)
    assert names(failsafe.evaluate(101 * MS, False)) == []
    assert failsafe.clear() == ()


def test_what_is_said_of_an_absent_condition_changes_nothing(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1, detail="code 1")
    failsafe.evaluate(2, True)
    failsafe.set(FAULT, False, 3)
    latched = failsafe.evaluate(4, True)
    failsafe.set(FAULT, False, 5, detail="no code")
    assert failsafe.evaluate(6, True) is latched
    failsafe.set(FAULT, False, 7)
    assert failsafe.clear() == ()
    assert names(failsafe.evaluate(8, True)) == []


@pytest.mark.parametrize("name", [SLOW_FAULT, SLOW_HELD])
def test_a_word_does_not_forget_what_has_not_fired_yet(failsafe: Failsafe, name: Example) -> None:
    failsafe.set(name, True, 0)
    failsafe.set(name, False, 80 * MS)
    failsafe.evaluate(80 * MS, True)
    failsafe.clear()
    failsafe.resume()
    failsafe.set(name, True, 80 * MS)
    assert names(failsafe.evaluate(100 * MS, True)) == [name]


def test_a_fault_from_standby_latches_once_energised(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1)
    failsafe.evaluate(2, False)
    failsafe.evaluate(3, True)
    failsafe.set(FAULT, False, 4)
    assert names(failsafe.evaluate(5, False)) == ["fault"]


def test_what_is_still_present_cannot_be_cleared_and_is_told(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 2, "b")
    failsafe.set(OTHER_FAULT, True, 1)
    failsafe.set(FAULT, True, 0, "a")
    failsafe.set(WARNING, True, 0)
    failsafe.set(HELD, True, 0)
    failsafe.evaluate(3, True)
    failsafe.set(FAULT, False, 4, "a")
    stay = failsafe.clear()
    assert [(one.cause.value, one.subject) for one in stay] == [("other_fault", ""), ("fault", "b")]
    assert names(failsafe.evaluate(5, True)) == ["other_fault", "fault", "held", "warning"]


def test_a_latched_fault_that_comes_again_keeps_its_first_time(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1, detail="code 1")
    failsafe.evaluate(2, True)
    failsafe.set(FAULT, False, 3)
    failsafe.evaluate(4, False)
    failsafe.set(FAULT, True, 5, detail="code 2")
    (reason,) = failsafe.evaluate(6, False).reasons
    assert (reason.since_ns, reason.detail, reason.latched) == (1, "code 2", False)


def test_a_cleared_fault_that_comes_again_is_a_new_one(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1, detail="code 1")
    failsafe.evaluate(2, True)
    failsafe.set(FAULT, False, 3)
    failsafe.clear()
    failsafe.set(FAULT, True, 7)
    (reason,) = failsafe.evaluate(8, True).reasons
    assert (reason.since_ns, reason.detail) == (7, "")


def test_a_chain_that_is_closed_again_leaves_a_fault_behind(failsafe: Failsafe) -> None:
    failsafe.set(CHAIN, True, 1)
    assert failsafe.evaluate(2, True).severity is Severity.ESTOP
    failsafe.set(CHAIN, False, 3)
    verdict = failsafe.evaluate(4, False)
    assert verdict.severity is Severity.FAULT
    assert names(verdict) == ["chain"]


# Resuming.


def test_a_hold_stays_until_the_operator_resumes(failsafe: Failsafe) -> None:
    failsafe.set(HELD, True, 1)
    failsafe.evaluate(2, True)
    failsafe.resume()
    assert names(failsafe.evaluate(3, True)) == ["held"], "it is still present"
    failsafe.set(HELD, False, 4)
    (reason,) = failsafe.evaluate(5, True).reasons
    assert reason.latched
    assert reason.severity is Severity.HOLD
    assert failsafe.clear() == ()
    assert names(failsafe.evaluate(6, True)) == ["held"]
    failsafe.resume()
    assert names(failsafe.evaluate(7, True)) == []


def test_a_hold_does_not_outlive_the_power(failsafe: Failsafe) -> None:
    failsafe.set(HELD, True, 1)
    failsafe.evaluate(2, True)
    failsafe.set(HELD, False, 3)
    assert names(failsafe.evaluate(4, False)) == []
    assert names(failsafe.evaluate(5, True)) == []


# Being cheap.


def test_while_nothing_changes_the_verdict_is_the_same_object(failsafe: Failsafe) -> None:
    assert failsafe.evaluate(0, True) is failsafe.evaluate(1, True)
    failsafe.set(FAULT, True, 2, detail="code 1")
    failsafe.set(SLOW, True, 2)
    first = failsafe.evaluate(3, True)
    failsafe.set(FAULT, True, 4, detail="code 1")
    failsafe.set(FAULT, True, 5)
    assert failsafe.evaluate(6, True) is first
    assert failsafe.evaluate(7, False) is first
    failsafe.set(FAULT, True, 8, detail="code 2")
    second = failsafe.evaluate(9, True)
    assert second is not first
    assert second.reasons[0].detail == "code 2"
    failsafe.set(FAULT, False, 10)
    latched = failsafe.evaluate(11, True)
    assert latched is not second
    assert failsafe.evaluate(12, True) is latched


def test_a_reason_that_another_one_joins_stays_the_same_object(failsafe: Failsafe) -> None:
    failsafe.set(FAULT, True, 1)
    (before,) = failsafe.evaluate(2, True).reasons
    failsafe.set(WARNING, True, 3)
    assert failsafe.evaluate(4, True).reasons[0] is before


NAMES = list(Cause)
happenings = st.lists(
    st.tuples(
        st.sampled_from(NAMES),
        st.sampled_from(["", "another subject"]),
        st.booleans(),
        st.integers(0, 2000 * MS),
        st.one_of(st.none(), st.sampled_from(list(Request))),
    ),
    max_size=25,
)


@examples(200)
@given(history=happenings)
def test_after_any_causes_and_power_changes_all_can_go(
    history: list[tuple[Cause, str, bool, int, Request | None]],
) -> None:
    """Over the whole table: once no condition holds, stopping and clearing lead back to READY."""
    failsafe, state, t_ns = Failsafe(), OperatingState.READY, 0

    def go(request: Request | None) -> OperatingState:
        verdict = failsafe.evaluate(t_ns, state.energised)
        blocked = bool(verdict.at_least(Severity.NOT_READY))
        return next_state(state, request, verdict.severity, blocked)

    for name, subject, present, after_ns, request in history:
        t_ns += after_ns
        failsafe.set(name, present, t_ns, subject)
        if request is Request.CLEAR:
            failsafe.clear()
        elif request is Request.RESUME:
            failsafe.resume()
        state = go(request)
    for name in NAMES:
        for subject in ("", "another subject"):
            failsafe.set(name, False, t_ns, subject)
    for request in (Request.STOP, None, None):
        t_ns += 10_000 * MS
        state = go(request)
    assert failsafe.clear() == ()
    state = go(Request.CLEAR)
    assert go(None) is OperatingState.READY
    assert not failsafe.watching
