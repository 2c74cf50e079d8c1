"""Each rule for an attack that was seen somewhere: without the rule its test fails."""

import pytest

from daemon.dashboard.http_rules import Asked, Rules, may, security_headers

PORT = 8420
TOKENS = {"secret-operator": "operator", "secret-viewer": "viewer"}
RULES = Rules(PORT, ("localhost", "127.0.0.1"), TOKENS)
OURS = f"http://localhost:{PORT}"


def asked(
    method: str = "GET",
    websocket: bool = False,
    cookies: dict[str, str] | None = None,
    **headers: str,
) -> Asked:
    sent = {"host": f"localhost:{PORT}"} | {k.replace("_", "-"): v for k, v in headers.items()}
    return Asked(method, "/", sent, cookies or {}, websocket)


def status(of: Asked) -> int:
    refused = RULES.refusal(of)
    return 200 if refused is None else refused.status


def test_a_page_that_is_asked_for_by_its_name_is_given() -> None:
    assert status(asked()) == 200
    assert status(asked(origin=OURS)) == 200
    assert status(asked(websocket=True, origin=OURS)) == 200
    assert status(asked("POST", origin=OURS, content_type="application/json; charset=utf-8")) == 200


@pytest.mark.parametrize(
    "host", ["evil.example:8420", "localhost:1", "localhost", "", "127.0.0.1.evil:8420"]
)
def test_a_name_that_somebody_else_has_pointed_here_is_refused(host: str) -> None:
    assert status(asked(host=host)) == 403
    assert status(asked(host=host, origin=f"http://{host}")) == 403, "both are the attacker's"


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:1", f"https://localhost:{PORT}"]
)
def test_another_site_s_page_is_refused_and_its_sockets_too(origin: str) -> None:
    assert status(asked(origin=origin)) == 403
    assert status(asked(websocket=True, origin=origin)) == 403
    assert status(asked("POST", origin=origin, content_type="application/json")) == 403


def test_who_does_not_say_where_from_gets_no_socket_and_does_nothing() -> None:
    assert status(asked(websocket=True)) == 403
    assert status(asked("POST", content_type="application/json")) == 403


def test_what_a_proxy_says_of_somebody_changes_nothing() -> None:
    assert status(asked(host="evil.example", x_forwarded_host=f"localhost:{PORT}")) == 403
    assert status(asked(origin="http://evil.example", x_forwarded_for="127.0.0.1")) == 403


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""]
)
def test_what_a_form_could_send_does_nothing(kind: str) -> None:
    assert status(asked("POST", origin=OURS, content_type=kind)) == 415


@pytest.mark.parametrize("method", ["DELETE", "PUT", "PATCH", "OPTIONS"])
def test_there_is_no_other_way_to_do_something(method: str) -> None:
    assert status(asked(method, origin=OURS, content_type="application/json")) == 405


def test_a_cookie_is_of_one_port_and_gives_the_role_of_its_token() -> None:
    assert RULES.cookie != Rules(PORT + 1, ("localhost",), TOKENS).cookie
    assert RULES.role(asked(cookies={RULES.cookie: "secret-operator"})) == "operator"
    assert RULES.role(asked(cookies={RULES.cookie: "secret-viewer"})) == "viewer"
    assert RULES.role(asked(cookies={RULES.cookie: "secret"})) is None
    assert RULES.role(asked(cookies={"other": "secret-operator"})) is None
    assert RULES.role(asked()) is None
    assert Rules(PORT, ("localhost",), {}).role(asked()) == "operator", "left to a proxy"


def test_viewers_do_nothing_but_stop() -> None:
    assert may("viewer", "stop") and may("operator", "stop") and may("operator", "arm")
    assert not may("viewer", "arm") and not may("viewer", "take")
    assert not may(None, "stop")


def test_nothing_runs_in_the_page_that_is_not_ours() -> None:
    headers = security_headers()
    policy = headers["Content-Security-Policy"]
    assert "unsafe" not in policy and policy.startswith("default-src 'none'")
    assert "script-src 'self' 'sha256-" in policy, "no script in the page itself but the one map"
    assert "worker-src 'self'" in policy, "workers draw the robot and keep the lease"
    assert "form-action 'none'" in policy and "base-uri 'none'" in policy
    assert "frame-ancestors 'none'" in policy and headers["X-Content-Type-Options"] == "nosniff"
