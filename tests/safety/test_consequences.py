"""Where one thing makes many go wrong, that one is told first, and the others under it."""

from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given, strategies

from safety.causes import Cause, Severity, cause
from safety.consequences import LEADS_LATER_TO, LEADS_TO, Consequences, with_leads
from safety.failsafe import ActiveReason

S = 1_000_000_000
CIRCLING = (
    *("node_lost", "bus_queue_full", "bus_degraded", "drive_no_voltage", "node_reset"),
    *("node_not_ready", "drive_fault", "arming_failed", "bus_off", "loop_late"),
)


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
        reason("tracker_gone", 10.01),
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


def test_of_leads_that_have_nothing_to_do_with_each_other_the_first_in_the_table_counts() -> None:
    ordered = ordered_once(
        reason("drive_fault", 10.0),
        reason("drive_settings_changed", 10.2),
        reason("arming_failed", 11),
    )
    assert ("arming_failed", "drive_settings_changed", False) in ordered


def test_a_drive_that_starts_anew_follows_from_its_supply() -> None:
    ordered = ordered_once(reason("drive_no_voltage", 10.0), reason("node_reset", 10.2))
    assert ordered == [("drive_no_voltage", "", False), ("node_reset", "drive_no_voltage", False)]


def test_a_group_is_as_bad_as_the_worst_in_it() -> None:
    ordered = ordered_once(
        reason("tracker_warning", 10.0), reason("tracker_gone", 13.0), reason("operator_hold", 1.0)
    )
    assert [name for name, _, _ in ordered] == ["tracker_warning", "tracker_gone", "operator_hold"]


@pytest.mark.parametrize(
    ("lead_at_s", "follow_at_s", "latched", "expected"),
    [
        (10.0, 9.0, True, "loop_stalled"),  # seen before its origin was
        (10.0, 8.999_999_999, True, ""),
        (10.0, 12.0, True, "loop_stalled"),  # so long after it was over
        (10.0, 12.000_000_001, True, ""),
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


def test_one_of_several_that_is_well_again_is_not_told_as_what_the_others_follow_from() -> None:
    consequences = Consequences()
    axes = [reason("not_referenced", 10.0 + 0.01 * n, f"axis_{n}") for n in range(3)]
    consequences.ordered(axes, 11 * S)
    left = consequences.ordered(axes[1:], 12 * S)
    assert [(one.subject, one.follows_from) for one in left] == [
        ("axis_1", ""),
        ("axis_2", "not_referenced"),
    ]


def test_the_same_much_later_stands_for_itself() -> None:
    at_once = ordered_once(reason("node_lost", 10.0, "a"), reason("node_lost", 10.5, "b"))
    assert [follows for _, follows, _ in at_once] == ["", "node_lost"]
    later = ordered_once(reason("node_lost", 10.0, "a"), reason("node_lost", 10.500_000_001, "b"))
    assert [follows for _, follows, _ in later] == ["", ""]


def test_a_lead_that_is_over_is_told_as_long_as_anything_follows_from_it() -> None:
    consequences = Consequences()
    late, fault = reason("loop_late", 10.0), reason("drive_fault", 10.05, latched=True)
    consequences.ordered([late], 10 * S)
    ordered = consequences.ordered([fault], round(10.06 * S))
    assert shown(ordered) == [("loop_late", "", True), ("drive_fault", "loop_late", False)]
    assert ordered[0].severity is Severity.NONE
    for at_s in (90, 95, 98):
        much_later = consequences.ordered([fault, reason("drive_warning", 90.0)], at_s * S)
        assert ("loop_late", "", True) in shown(much_later)
    assert consequences.ordered([], 99 * S) == ()
    assert shown(consequences.ordered([reason("drive_fault", 105.0)], 105 * S)) == [
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


@pytest.mark.parametrize("latched", [False, True])
def test_what_stood_between_may_be_forgotten(latched: bool) -> None:
    consequences, unready = Consequences(), reason("node_not_ready", 10.0)
    slack = reason("tendon_slack", 10.2, latched=latched)
    assert ("tendon_slack", "", False) in ordered_once(unready, slack)
    consequences.ordered(worst_first(unready, reason("drive_not_enabled", 10.1), slack), 11 * S)
    for at_s in (20, 30, 40, 50):
        ordered = consequences.ordered(worst_first(unready, slack), at_s * S)
    assert ("tendon_slack", "node_not_ready", False) in shown(ordered)


def test_a_lead_is_told_as_it_is_by_now() -> None:
    consequences = Consequences()
    late, fault = reason("loop_late", 10.0), reason("drive_fault", 10.1)
    consequences.ordered(worst_first(late, fault), 11 * S)
    by_now = replace(late, detail="20 ms", latched=True)
    ordered = consequences.ordered(worst_first(by_now, fault), 12 * S)
    assert ordered[0] == by_now
    gone = consequences.ordered([fault], 13 * S)
    assert gone[0] == replace(by_now, over=True, latched=False)


def test_what_is_only_kept_to_be_read_leads_no_longer_for_it() -> None:
    consequences, stalled = Consequences(), reason("loop_stalled", 10.0, latched=True)
    for at_s in (10, 13, 14):
        consequences.ordered([stalled], at_s * S)
    ordered = consequences.ordered(worst_first(stalled, reason("node_lost", 15.0)), 15 * S)
    assert ("node_lost", "", False) in shown(ordered)


def test_what_is_there_again_leads_again() -> None:
    consequences = Consequences()
    over, again = reason("loop_late", 10.0, latched=True), reason("loop_late", 10.0)
    consequences.ordered([over], 10 * S)
    ordered = consequences.ordered(worst_first(again, reason("node_lost", 50.0)), 50 * S)
    assert ("node_lost", "loop_late", False) in shown(ordered)


@pytest.mark.parametrize(
    ("follow_at_s", "expected"), [(41.5, "loop_late"), (43.0, "loop_late"), (43.000_000_001, "")]
)
def test_it_leads_for_a_while_after_it_has_gone(follow_at_s: float, expected: str) -> None:
    consequences = Consequences()
    for at_s in (10, 40):
        consequences.ordered([reason("loop_late", 10.0)], at_s * S)
    for at_s in (41, 42, 43):
        assert consequences.ordered([], at_s * S) == ()
    ordered = consequences.ordered([reason("node_lost", follow_at_s)], 44 * S)
    assert ("node_lost", expected, False) in shown(ordered)


def test_what_comes_back_when_its_lead_is_forgotten_stands_for_itself() -> None:
    consequences = Consequences()
    late, lost = reason("loop_late", 10.0), reason("node_lost", 10.1)
    consequences.ordered(worst_first(late, lost), round(10.2 * S))
    consequences.ordered([lost], 11 * S)
    consequences.ordered([], round(12.5 * S))
    consequences.ordered([], round(13.5 * S))
    assert shown(consequences.ordered([lost], 14 * S)) == [("node_lost", "", False)]


def each_once(ordered: tuple[ActiveReason, ...]) -> list[str]:
    return sorted(f"{one.cause.value} {one.subject}" for one in ordered)


def test_a_lead_that_comes_anew_after_what_followed_from_it_is_told_once() -> None:
    consequences = Consequences()
    full = reason("bus_queue_full", 12.0)
    before = consequences.ordered(worst_first(reason("node_lost", 10.0), full), 13 * S)
    assert ("bus_queue_full", "node_lost", False) in shown(before)
    for at_s in (20, 30):
        ordered = consequences.ordered(worst_first(reason("node_lost", 20.0), full), at_s * S)
        assert shown(ordered) == [
            ("bus_queue_full", "", False),
            ("node_lost", "bus_queue_full", False),
        ]


def test_of_causes_that_could_each_follow_from_another_the_oldest_leads() -> None:
    consequences = Consequences()
    reasons = worst_first(
        reason("node_lost", 10.0),
        reason("drive_no_voltage", 10.7),
        reason("bus_queue_full", 11.5),
        reason("arming_failed", 11.6),
    )
    for at_s in (12, 13, 20):
        ordered = consequences.ordered(reasons, at_s * S)
        assert each_once(ordered) == each_once(tuple(reasons))
        assert shown(ordered)[0] == ("node_lost", "", False)
        assert {follows for _, follows, _ in shown(ordered)[1:]} == {"node_lost"}


@given(data=strategies.data())
def test_whatever_comes_and_goes_nothing_is_lost_or_told_twice(data: strategies.DataObject) -> None:
    moments = strategies.integers(0, 12).map(lambda quarter: 10.0 + quarter / 4.0)
    keys = strategies.tuples(strategies.sampled_from(CIRCLING), strategies.sampled_from("ab"))
    consequences = Consequences()
    for at_s in (13, 14, 17):
        present = data.draw(strategies.dictionaries(keys, moments, max_size=8))
        reasons = worst_first(*(reason(name, at, who) for (name, who), at in present.items()))
        ordered = consequences.ordered(reasons, at_s * S)
        assert each_once(tuple(one for one in ordered if not one.over)) == each_once(tuple(reasons))
        assert len(set(each_once(ordered))) == len(ordered)


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
    late = [replace(reason("loop_late", 9.0), over=True)]
    late += [replace(reason("drive_fault", 9.1), follows_from="loop_late")]
    kept = [one.cause.value for one in with_leads((*ordered, *late), Severity.HOLD)]
    assert kept[3:] == ["loop_late", "drive_fault"]
    assert with_leads((), Severity.NONE) == ()
