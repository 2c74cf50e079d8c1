"""`remote:` in a robot file: what would leave a door open, or nobody let in, is told."""

from typing import Any

import pytest
from pydantic import ValidationError

from config.remote import Remote

TLS = {"endpoint": "192.168.1.10:7448", "certificates": "certificates"}


def settings(**content: Any) -> Remote:
    return Remote.model_validate(content)


def test_by_itself_a_daemon_can_be_reached_from_its_own_machine_and_user_only() -> None:
    remote = settings()
    assert (remote.unix_socket, remote.group_may_connect, remote.tls) == (True, False, None)
    assert remote.role("local") == "operator"
    assert remote.role("alice") is None
    assert settings(unix_socket=False).role("local") is None


def test_users_have_the_roles_that_are_written_down() -> None:
    remote = settings(tls=TLS, users={"alice": "operator", "bob": "viewer"})
    assert [remote.role(user) for user in ("alice", "bob", "mallory")] == [
        "operator",
        "viewer",
        None,
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"tls": TLS}, "nobody could come over tls"),
        ({"users": {"alice": "operator"}}, "they come over tls, which is not there"),
        ({"tls": TLS, "users": {"local": "viewer"}}, "is whoever uses the unix socket"),
        ({"tls": TLS, "users": {"alice": "admin"}}, "users.alice"),
        ({"tls": TLS, "users": {"Alice": "viewer"}}, "users.Alice"),
        ({"tls": TLS, "users": {"*": "viewer"}}, "users.*"),
        ({"tls": {**TLS, "endpoint": "host"}, "users": {"a": "viewer"}}, "tls.endpoint"),
        ({"tls": {**TLS, "endpoint": "h:99999"}, "users": {"a": "viewer"}}, "1 to 65535"),
        ({"unix_socket_path": ""}, "unix_socket_path"),
        ({"multicast": True}, "multicast"),
    ],
)
def test_what_makes_no_sense_is_refused(content: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        settings(**content)
    assert message in str(caught.value)
