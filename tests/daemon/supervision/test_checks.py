"""Causes have one home: one module raises them, each by one line of it."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.supervision.condition_causes import CAUSE_OF_CONDITION
from safety.causes import Cause

ROOT = Path(__file__).parents[3]
PRODUCT = ("config", "safety", "drivers", "sim_backends", "daemon")
HOME = "daemon/supervision/checks.py"
TABLE = "safety/causes.py"
SEEN_TWICE = {
    Cause.TRACKER_NOT_READY,
    Cause.BUS_NOT_OPEN,
    Cause.NODE_NOT_READY,
    Cause.DRIVE_NOT_ENABLED,
    Cause.DRIVE_FOLLOWING_ERROR,
}
"""What a driver's condition says, and the daemon sees too: a driver may have nothing to say yet."""
OF_OTHER_THINGS = {
    "config/patience.py",
    "drivers/can/conditions.py",
    "drivers/cia402/conditions.py",
    "sim_backends/devices/can/faults.py",
}
"""Conditions of drivers, faults of devices and keys of robot files may be called like the causes
that they lead to."""


def sources(*words: str) -> Iterator[tuple[str, ast.Module]]:
    """Those in whose text one of the words stands: to parse all others takes its time."""
    for top in PRODUCT:
        for path in sorted((ROOT / top).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if any(word in text for word in words):
                yield str(path.relative_to(ROOT)), ast.parse(text)


def named(tree: ast.AST) -> Counter[str]:
    """How often each cause is named as a member of the enumeration."""
    return Counter(
        node.attr.lower()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "Cause"
    )


def calls_of_set(tree: ast.AST) -> list[int]:
    """Lines that raise or withdraw a cause: `…failsafe.set(…)`, or `self._set(Cause.…)`."""
    return [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr in ("set", "_set")
        and (
            (isinstance(node.value, ast.Attribute) and node.value.attr.endswith("failsafe"))
            or (isinstance(node.value, ast.Name) and node.value.id == "failsafe")
        )
    ]


def test_one_module_alone_raises_causes() -> None:
    assert [path for path, tree in sources("failsafe") if calls_of_set(tree)] == [HOME]


def test_every_cause_is_raised_by_one_line_or_by_conditions_of_drivers() -> None:
    home = ast.parse((ROOT / HOME).read_text(encoding="utf-8"))
    by_line, by_condition = named(home), {*CAUSE_OF_CONDITION.values()}
    assert {name: count for name, count in by_line.items() if count > 1} == {}
    assert by_line.keys() | by_condition == {*Cause}
    assert by_line.keys() & by_condition == SEEN_TWICE


def test_nobody_names_a_cause_by_a_bare_string() -> None:
    names = {cause.value for cause in Cause}
    bare = [
        f"{path}:{node.lineno}: {node.value}"
        for path, tree in sources(*names)
        if path != TABLE and path not in OF_OTHER_THINGS
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and node.value in names
    ]
    assert bare == []


@pytest.mark.parametrize(
    "code",
    [
        "self._supervisor.failsafe.set(Cause.LOOP_LATE, True, 0)",
        'failsafe.set("loop_late", True, 0)',
        "raised = self._failsafe.set",
    ],
)
def test_the_walk_sees_who_raises(code: str) -> None:
    assert calls_of_set(ast.parse(code)) == [1]
