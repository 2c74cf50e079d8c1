"""Where one thing makes many go wrong, that one is told first, and the others under it."""

from itertools import product

import pytest

from safety.causes import Cause, Severity, cause
from safety.consequences import LEADS_LATER_TO, LEADS_TO, Consequences, with_leads
from safety.failsafe import ActiveReason

S = 1_000_000_000


def reason(name: str, at_s: float, subject: str = "x", *, latched: bool = False) -> ActiveReason:
    return ActiveReason(cause(name), subject, "", round(at_s * S), latched)


def worst_first(*reasons: ActiveReason) -> list[ActiveReason]:
    return sorted(reasons, key=lambda one: (-one.severity, one.since_ns, one.cause.value))


def shown(ordered: tuple[ActiveReason, ...]) -> list[tuple[str, str, bool]]:
    return [(one.cause.value, one.follows_from, one.over) for one in ordered]


def ordered_once(*reasons: ActiveReason, at_s: float = 100.0) -> list[tuple[str, str, bool]]:
    return shown(Consequences().ordered(worst_first(*reasons), round(at_s * S)))


def test_the_table_names_causes_and_goes_in_no_circle() -> None:
    names = {row.value for row in Cause}
    order = list(LEADS_TO)
    for lead, follow in LEADS_TO.items():
        assert {lead, *follow} <= names
        assert lead not in follow
        assert len(set(follow)) == len(follow), lead
        for one in follow:
            assert one not in order or order.index(one) > order.index(lead), (lead, one)


def test_what_follows_comes_behind_what_it_follows_from() -> None:
    ordered = ordered_once(
        reason("loop_stalled", 10.0, latched=True),
        reason("drive_fault", 9.7, "a", latched=True),
        reason("tracker_late", 10.01),
        reason("node_lost", 10.02, "b", latched=True),
    )
    assert ordered[0] == ("loop_stalled", "", False)
    assert {follows for _, follows, _ in ordered[1:]} == {"loop_stalled"}


def test_of_several_that_may_lead_the_one_nearest_to_the_origin_does() -> None:
    ordered = ordered_once(
        reason("node_lost", 10.0), reason("node_not_ready", 10.1), reason("bus_off", 10.0)
    )
    assert ordered == [
        ("bus_off", "", False),
        ("node_lost", "bus_off", False),
        ("node_not_ready", "bus_off", False),
    ]


def test_a_group_is_as_bad_as_the_worst_in_it() -> None:
    ordered = ordered_once(
        reason("tracker_warning", 10.0), reason("tracker_gone", 13.0), reason("operator_hold", 1.0)
    )
    assert [name for name, _, _ in ordered] == ["tracker_warning", "tracker_gone", "operator_hold"]


@pytest.mark.parametrize(
    ("lead_at_s", "follow_at_s", "latched", "expected"),
    [
        (10.0, 9.0, True, "loop_stalled"),  # seen before its origin was
        (10.0, 8.9, True, ""),
        (10.0, 12.0, True, "loop_stalled"),  # so long after it was over
        (10.0, 12.1, True, ""),
        (10.0, 50.0, False, "loop_stalled"),  # it still goes on
    ],
)
def test_it_follows_only_in_its_time(
    lead_at_s: float, follow_at_s: float, latched: bool, expected: str
) -> None:
    consequences = Consequences()
    lead = reason("loop_stalled", lead_at_s, latched=latched)
    consequences.ordered([lead], round(lead_at_s * S))
    ordered = consequences.ordered(
        worst_first(lead, reason("node_lost", follow_at_s)), round(follow_at_s * S)
    )
    assert ("node_lost", expected, False) in shown(ordered)


@pytest.mark.parametrize("full", ["bus_queue_full", "bus_degraded"])
@pytest.mark.parametrize(
    ("full_at_s", "first"), [(9.0, "bus"), (10.0, "bus"), (11.0, "bus"), (11.1, "node")]
)
def test_a_queue_that_is_full_long_after_the_drives_have_gone_follows_from_that(
    full: str, full_at_s: float, first: str
) -> None:
    ordered = ordered_once(
        reason("node_lost", 10.0, latched=True),
        reason("node_not_ready", 11.5),
        reason(full, full_at_s),
    )
    leads = {name for name, follows, _ in ordered if not follows}
    if first == "node":
        assert leads == {"node_lost"}
        assert {follows for _, follows, _ in ordered[1:]} == {"node_lost"}
    elif full == "bus_queue_full":
        assert leads == {"bus_queue_full"}
    else:  # a bus that is worse than it should be explains no drive
        assert leads == {"bus_degraded", "node_lost"}


def test_what_leads_later_is_in_the_table_the_other_way_round_or_not_at_all() -> None:
    names = {row.value for row in Cause}
    for lead, follow in LEADS_LATER_TO.items():
        assert {lead, *follow} <= names
        assert not set(follow) & set(LEADS_TO.get(lead, ()))


def test_what_has_nothing_to_do_with_it_does_not_follow() -> None:
    ordered = ordered_once(reason("node_lost", 10.0), reason("tracker_late", 10.0))
    assert [follows for _, follows, _ in ordered] == ["", ""]


def test_the_same_of_several_drives_at_once_has_one_origin() -> None:
    ordered = ordered_once(*(reason("node_lost", 10.0 + 0.1 * n, f"can0/{n}") for n in range(4)))
    assert [follows for _, follows, _ in ordered] == ["", "node_lost", "node_lost", "node_lost"]


def test_the_same_much_later_stands_for_itself() -> None:
    ordered = ordered_once(reason("node_lost", 10.0, "a"), reason("node_lost", 10.6, "b"))
    assert [follows for _, follows, _ in ordered] == ["", ""]


def test_a_lead_that_is_over_is_told_as_long_as_anything_follows_from_it() -> None:
    consequences = Consequences()
    late, fault = reason("loop_late", 10.0), reason("drive_fault", 10.05, latched=True)
    consequences.ordered([late], 10 * S)
    ordered = consequences.ordered([fault], round(10.06 * S))
    assert shown(ordered) == [("loop_late", "", True), ("drive_fault", "loop_late", False)]
    assert ordered[0].severity is Severity.NONE
    much_later = consequences.ordered([fault, reason("drive_warning", 90.0)], 90 * S)
    assert ("loop_late", "", True) in shown(much_later)
    assert consequences.ordered([], 91 * S) == ()
    assert shown(consequences.ordered([reason("drive_fault", 95.0)], 95 * S)) == [
        ("drive_fault", "", False)
    ]
    assert [key[0] for key in consequences._known] == ["drive_fault"]


def test_what_stood_between_may_go() -> None:
    consequences = Consequences()
    stalled = reason("loop_stalled", 10.0, latched=True)
    lost, unready = reason("node_lost", 10.1), reason("node_not_ready", 10.2)
    consequences.ordered(worst_first(stalled, lost, unready), 11 * S)
    for at_s in (20, 30):
        ordered = consequences.ordered(worst_first(stalled, unready), at_s * S)
    assert shown(ordered) == [
        ("loop_stalled", "", False),
        ("node_not_ready", "loop_stalled", False),
    ]


def test_what_has_come_anew_is_looked_at_anew() -> None:
    consequences = Consequences()
    stalled = reason("loop_stalled", 10.0, latched=True)
    consequences.ordered(worst_first(stalled, reason("node_lost", 10.1)), 11 * S)
    ordered = consequences.ordered(worst_first(stalled, reason("node_lost", 40.0)), 40 * S)
    assert [follows for _, follows, _ in shown(ordered)] == ["", ""]


def test_a_lead_that_comes_last_is_told_first() -> None:
    consequences = Consequences()
    lost = reason("node_lost", 10.0)
    assert shown(consequences.ordered([lost], 10 * S)) == [("node_lost", "", False)]
    ordered = consequences.ordered(worst_first(lost, reason("bus_off", 10.5)), 11 * S)
    assert shown(ordered) == [("bus_off", "", False), ("node_lost", "bus_off", False)]


def test_nothing_is_lost_and_nothing_is_told_twice() -> None:
    everything = [reason(row.value, 10.0, subject) for row, subject in product(Cause, "ab")]
    ordered = Consequences().ordered(worst_first(*everything), 11 * S)
    assert {(one.cause.value, one.subject) for one in ordered} == {
        (one.cause.value, one.subject) for one in everything
    }
    assert len(ordered) == len(everything)
    leads = {one.cause.value for one in ordered if not one.follows_from}
    assert "internal_error" in leads
    assert not leads & {"node_lost", "tracker_late", "drive_fault", "loop_slow"}


def test_of_those_that_are_bad_enough_each_comes_with_its_lead() -> None:
    ordered = Consequences().ordered(
        worst_first(
            reason("tracker_warning", 10.0),
            reason("tracker_late", 10.1),
            reason("tracker_quality", 10.2),
            reason("loop_slow", 1.0),
            reason("bus_degraded", 1.0),
        ),
        11 * S,
    )
    kept = [one.cause.value for one in with_leads(ordered, Severity.HOLD)]
    assert kept == ["tracker_warning", "tracker_late", "tracker_quality"]
    assert with_leads(ordered, Severity.FAULT) == ()
    assert with_leads((), Severity.NONE) == ()
