"""The names under which everything is published and asked for."""

import pytest
import zenoh

from daemon.remote.keys import ANY_ROBOT_ALIVE, TELEMETRY_KEYS, Keys, is_exact, last_part, robot_of

KEYS = Keys("soft_arm")


def test_keys_are_those_of_the_documentation() -> None:
    assert [KEYS.telemetry(name) for name in TELEMETRY_KEYS] == [
        "tentacled/soft_arm/state",
        "tentacled/soft_arm/tip",
        "tentacled/soft_arm/axes",
        "tentacled/soft_arm/risk",
        "tentacled/soft_arm/loop",
        "tentacled/soft_arm/event",
        "tentacled/soft_arm/body",
    ]
    assert KEYS.events == "tentacled/soft_arm/events"
    assert KEYS.surroundings == "tentacled/soft_arm/surroundings"
    assert KEYS.surroundings_part(7) == "tentacled/soft_arm/surroundings/7"
    assert KEYS.command("alice", "arm") == "tentacled/soft_arm/cmd/alice/arm"
    assert KEYS.setpoint("alice") == "tentacled/soft_arm/setpoint/alice"
    assert KEYS.obstacles("alice") == "tentacled/soft_arm/obstacles/alice"
    assert KEYS.whoami("alice") == "tentacled/soft_arm/whoami/alice"
    assert KEYS.schema("tip") == "tentacled/soft_arm/schema/tip"
    assert KEYS.alive == "tentacled/soft_arm/alive"


@pytest.mark.parametrize("name", ["", "*", "**", "a/b", "Alice", "a b", "ä", "1", "a$*", "x" * 64])
def test_what_cannot_be_part_of_a_key_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a key"):
        Keys(name)
    for make in (KEYS.setpoint, KEYS.obstacles, KEYS.whoami, KEYS.schema, KEYS.commands):
        with pytest.raises(ValueError, match="cannot be part of a key"):
            make(name)
    with pytest.raises(ValueError, match="cannot be part of a key"):
        KEYS.command("alice", name)


def test_only_what_is_published_can_be_listened_to() -> None:
    with pytest.raises(ValueError, match="'cmd' is not published"):
        KEYS.telemetry("cmd")


def test_wildcards_are_told_from_exact_keys() -> None:
    assert is_exact(KEYS.command("alice", "arm"))
    for key in (KEYS.commands("alice"), "tentacled/**", "tentacled/soft_arm/cmd/alice/ar$*"):
        assert not is_exact(key)


def test_a_key_gives_back_its_parts() -> None:
    assert last_part(KEYS.command("alice", "arm")) == "arm"
    assert robot_of(KEYS.alive) == "soft_arm"
    assert zenoh.KeyExpr(ANY_ROBOT_ALIVE).includes(KEYS.alive)
