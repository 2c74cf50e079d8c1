"""Conditions come once, go once, and are told of."""

from drivers.conditions import Condition, ConditionChange, Conditions

ONE = Condition("one", "one is wrong", "mend one")
TWO = Condition("two", "two is wrong", "mend two")


def changes_of(changes: list[ConditionChange]) -> list[tuple[str, str, bool]]:
    return [(c.active.condition.name, c.active.subject, c.present) for c in changes]


def test_a_condition_is_told_when_it_comes_and_when_it_goes() -> None:
    changes: list[ConditionChange] = []
    conditions = Conditions(changes.append)
    conditions.set(ONE, "can0", 1, "first")
    conditions.set(ONE, "can0", 2, "again")
    assert [(a.detail, a.since_ns) for a in conditions.active()] == [("first", 1)]
    conditions.clear(ONE, "can0", 3)
    conditions.clear(ONE, "can0", 4)
    assert changes_of(changes) == [("one", "can0", True), ("one", "can0", False)]
    assert conditions.active() == []


def test_the_same_condition_of_two_subjects_is_two() -> None:
    conditions = Conditions()
    conditions.set(ONE, "can0/1", 1)
    conditions.set(ONE, "can0/2", 2)
    conditions.clear(ONE, "can0/1", 3)
    assert conditions.holds(ONE, "can0/2")
    assert not conditions.holds(ONE, "can0/1")


def test_a_note_is_over_as_soon_as_it_is_told() -> None:
    changes: list[ConditionChange] = []
    conditions = Conditions(changes.append)
    conditions.note(ONE, "tracker", 5)
    assert [change.present for change in changes] == [True, False]
    assert conditions.active() == []


def test_all_of_a_subject_can_be_cleared_but_for_some() -> None:
    conditions = Conditions()
    for condition in (ONE, TWO):
        for subject in ("a", "b"):
            conditions.set(condition, subject, 0)
    conditions.clear_subject("a", 1, keep=(TWO,))
    assert {(x.condition.name, x.subject) for x in conditions.active()} == {
        ("two", "a"),
        ("one", "b"),
        ("two", "b"),
    }
