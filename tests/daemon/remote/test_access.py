"""The configuration of both ends: nothing found by itself, nobody let in without a rule."""

from pathlib import Path
from typing import Any

import pytest
import zenoh

from daemon.remote.access import (
    User,
    access_control,
    client_config,
    daemon_config,
    unix_endpoint,
)
from daemon.remote.keys import Keys

KEYS = Keys("soft_arm")
USERS = (
    User("local", "operator"),
    User("alice", "operator"),
    User("bob", "viewer"),
)


def rules_of(user: str) -> list[dict[str, Any]]:
    control = access_control(KEYS, USERS)
    names = [n for p in control["policies"] if user in p["subjects"] for n in p["rules"]]
    return [rule for rule in control["rules"] if rule["id"] in names]


def test_what_is_not_allowed_is_denied() -> None:
    control = access_control(KEYS, USERS)
    assert control["enabled"] is True
    assert control["default_permission"] == "deny"
    assert {rule["permission"] for rule in control["rules"]} == {"allow"}


def test_no_subject_is_everybody() -> None:
    for subject in access_control(KEYS, USERS)["subjects"]:
        assert subject["link_protocols"] == ["unixsock-stream"]


def test_every_rule_is_used_and_there() -> None:
    control = access_control(KEYS, USERS)
    used = {name for policy in control["policies"] for name in policy["rules"]}
    assert used == {rule["id"] for rule in control["rules"]}


def test_a_viewer_sends_nothing_but_questions_about_what_may_be_seen() -> None:
    sent = [rule for rule in rules_of("bob") if "ingress" in rule["flows"]]
    assert {message for rule in sent for message in rule["messages"]} == {
        "declare_subscriber",
        "query",
        "liveliness_query",
        "declare_liveliness_subscriber",
    }
    forbidden = ("/cmd/", "/setpoint", "/obstacles")
    keys = [key for rule in sent for key in rule["key_exprs"]]
    assert not any(word in key for key in keys for word in forbidden)


def test_an_operator_puts_streams_under_the_own_name_and_nothing_else() -> None:
    puts = [rule for rule in rules_of("alice") if "put" in rule["messages"]]
    sent = [rule["key_exprs"] for rule in puts if "ingress" in rule["flows"]]
    root = "tentacled/soft_arm"
    assert sent == [[f"{root}/setpoint/alice", f"{root}/obstacles/alice"]]


@pytest.mark.parametrize("role", ["admin", ""])
def test_an_access_that_does_not_exist_is_refused(role: str) -> None:
    with pytest.raises(ValueError, match="no such access"):
        User("alice", role)


def test_the_daemon_listens_where_it_is_told_and_looks_for_nobody(tmp_path: Path) -> None:
    endpoint = unix_endpoint(tmp_path / "zenoh.sock")
    config = daemon_config(KEYS, USERS, [endpoint])
    assert config["mode"] == "peer"
    assert config["listen"]["endpoints"] == [endpoint]
    assert config["connect"]["endpoints"] == []
    for one in (config, client_config("tls/127.0.0.1:7448")):
        zenoh.Config.from_json5(str(one).replace("True", "true").replace("False", "false"))
        assert one["scouting"]["multicast"]["enabled"] is False
        assert one["scouting"]["gossip"]["autoconnect"] == {"peer": [], "router": [], "client": []}
        assert one["transport"]["shared_memory"]["enabled"] is False
        assert "tcp" not in one["transport"]["link"]["protocols"]


@pytest.mark.parametrize(("users", "endpoints"), [((), ["tls/x:1"]), (USERS, [])])
def test_a_daemon_without_users_or_endpoints_makes_no_sense(
    users: tuple[User, ...], endpoints: list[str]
) -> None:
    with pytest.raises(ValueError, match="nobody can reach"):
        daemon_config(KEYS, users, endpoints)


@pytest.mark.parametrize("path", ["/tmp/" + "x" * 103, "/tmp/a#b", "/tmp/a?b", "/tmp/a;b"])
def test_paths_that_cannot_be_a_socket_are_refused(path: str) -> None:
    with pytest.raises(ValueError, match="the path of a unix socket"):
        unix_endpoint(Path(path))
