"""zenoh's configuration for both ends, and who may send what: all that is not allowed is denied.

Rules are evaluated at the daemon: `ingress` is what a client sends, `egress` what it gets. Each
user has a session of the daemon's to talk to, behind a socket of its own: who opens it is the user.
A subject without any property would be everybody, so each has its link's kind at least.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from daemon.remote.keys import ANY_ROBOT_ALIVE, TELEMETRY_KEYS, Keys
from daemon.remote.wire import LARGEST_ANSWER_BYTES, LARGEST_MESSAGE_BYTES

Json = dict[str, Any]

UNIX: Final = "unixsock-stream"
TLS: Final = "tls"
OPERATOR: Final = "operator"
ROLES: Final = (OPERATOR, "viewer")
_MOST_SESSIONS: Final = 32
_MOST_PENDING: Final = 256
_OPENS_WITHIN_MS: Final = 1000
"""Who has connected and does not open a session within this time is hung up on."""
_LEASE_MS: Final = 1000
_SETPOINTS_HZ: Final = 1000.0
"""More often than this one client's set-points are not taken; the newest counts anyway."""
_LONGEST_SOCKET_PATH: Final = 107
_MAP_OVERHEAD_BYTES: Final = 4096
_HUNG_CLIENT_US: Final = 200_000
"""So long an answer waits for a client that does not read; then its connection is closed."""
_DROP_AFTER_US: Final = 500
"""So long the loop waits for a congested subscriber, once; then telemetry is dropped."""


@dataclass(frozen=True)
class User:
    """Somebody who may connect."""

    name: str
    role: str

    def __post_init__(self) -> None:
        if self.role not in ROLES:
            raise ValueError(f"no such access: {self}")

    @property
    def may_command(self) -> bool:
        return self.role == OPERATOR


def unix_endpoint(path: Path) -> str:
    """The endpoint of a unix socket. Raises ValueError where such a path is impossible."""
    text = str(path)
    if len(text.encode()) > _LONGEST_SOCKET_PATH:
        raise ValueError(f"the path of a unix socket must be shorter: {text}")
    if any(letter in text for letter in "#?;,"):
        raise ValueError(f"the path of a unix socket must be without # ? ; and comma: {text}")
    return f"{UNIX}/{text}"


def daemon_config(keys: Keys, users: Sequence[User], endpoints: Sequence[str]) -> Json:
    """The daemon: a peer that listens on `endpoints`, finds nobody by itself, and denies."""
    if not endpoints or not users:
        raise ValueError("a daemon that nobody can reach needs no server")
    config = _base("peer")
    config["listen"] = {"endpoints": list(endpoints)}
    config["connect"] = {"endpoints": []}
    config["timestamping"] = {"enabled": True}
    config["queries_default_timeout"] = 2000
    config["access_control"] = access_control(keys, users)
    streams = [
        {"key_expr": f"{keys.root}/{name}/*", "freq": _SETPOINTS_HZ}
        for name in ("setpoint", "obstacles")
    ]
    config["downsampling"] = [
        {"id": "streams", "messages": ["put"], "flows": ["ingress"], "rules": streams}
    ]
    config["low_pass_filter"] = [
        {
            "id": "size",
            "messages": ["put", "query"],
            "flows": ["ingress"],
            "key_exprs": ["**"],
            "size_limit": LARGEST_MESSAGE_BYTES + _MAP_OVERHEAD_BYTES,
        }
    ]
    unicast = config["transport"]["unicast"]
    unicast |= {
        "max_sessions": _MOST_SESSIONS,
        "accept_pending": _MOST_PENDING,
        "accept_timeout": _OPENS_WITHIN_MS,
    }
    return config


def client_config(
    endpoint: str, tls: Mapping[str, object] | None = None, wait_s: float = 0.0
) -> Json:
    """A client. wait_s: how long to wait for a daemon that is not there yet.

    Its own short lease is what lets the daemon see soon that the client's machine is gone.
    """
    config = _base("client")
    config["transport"]["link"]["rx"]["max_message_size"] = 2 * LARGEST_ANSWER_BYTES
    config["connect"] = {
        "endpoints": [endpoint],
        "timeout_ms": round(wait_s * 1e3),
        "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    }
    if tls is not None:
        config["transport"]["link"]["tls"] = dict(tls)
    return config


def client_tls(folder: Path, user: str) -> Json:
    """Where `user` has the certificates."""
    return {
        "root_ca_certificate": str(folder / "ca.pem"),
        "connect_certificate": str(folder / f"{user}.pem"),
        "connect_private_key": str(folder / f"{user}.key"),
        "enable_mtls": True,
        "verify_name_on_connect": True,
    }


def _base(mode: str) -> Json:
    nobody: Json = {"peer": [], "router": [], "client": []}
    congestion = {
        "drop": {"wait_before_drop": _DROP_AFTER_US},
        "block": {"wait_before_close": _HUNG_CLIENT_US},
    }
    return {
        "mode": mode,
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": True, "autoconnect": nobody},
        },
        "adminspace": {"enabled": False},
        "plugins_loading": {"enabled": False},
        "transport": {
            "unicast": {"open_timeout": 3000},
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": [TLS, UNIX],
                "rx": {"max_message_size": 2 * LARGEST_MESSAGE_BYTES},
                "tx": {
                    "lease": _LEASE_MS,
                    "keep_alive": 4,
                    "queue": {"congestion_control": congestion},
                },
            },
        },
    }


def access_control(keys: Keys, users: Sequence[User]) -> Json:
    """Default deny; then for everybody what all may see, and for each user the own commands."""
    rules = list(_watching(keys))
    for_all = [rule["id"] for rule in rules]
    policies = [{"rules": for_all, "subjects": [user.name for user in users]}]
    for user in users:
        own = list(_own(keys, user))
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [user.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [_subject(user) for user in users],
        "policies": policies,
    }


def _subject(user: User) -> Json:
    return {"id": user.name, "link_protocols": [UNIX]}


def _watching(keys: Keys) -> Sequence[Json]:
    telemetry = [keys.telemetry(name) for name in TELEMETRY_KEYS]
    answered = [
        *telemetry,
        keys.schemas,
        keys.events,
        keys.surroundings,
        keys.surroundings_part(),
    ]
    return [
        _allow("telemetry", "egress", ["put", "delete"], telemetry),
        _allow("subscribe", "ingress", ["declare_subscriber"], telemetry),
        _allow("announce", "egress", ["declare_queryable"], answered),
        _allow("read", "ingress", ["query"], answered),
        _allow("read_answer", "egress", ["reply"], answered),
        _allow("alive", "egress", ["liveliness_token"], [keys.alive]),
        _allow(
            "look_for_alive",
            "ingress",
            ["liveliness_query", "declare_liveliness_subscriber"],
            [ANY_ROBOT_ALIVE],
        ),
    ]


def _own(keys: Keys, user: User) -> Sequence[Json]:
    queryables = [keys.whoami(user.name)]
    if user.may_command:
        queryables.append(keys.commands(user.name))
    rules = [
        _allow(f"{user.name}_announce", "egress", ["declare_queryable"], queryables),
        _allow(f"{user.name}_ask", "ingress", ["query"], queryables),
        _allow(f"{user.name}_answer", "egress", ["reply"], queryables),
    ]
    if user.may_command:
        setpoint = [keys.setpoint(user.name), keys.obstacles(user.name)]
        rules += [
            _allow(f"{user.name}_listen", "egress", ["declare_subscriber"], setpoint),
            _allow(f"{user.name}_setpoint", "ingress", ["put"], setpoint),
        ]
    return rules


def _allow(name: str, flow: str, what: Sequence[str], keys: Sequence[str]) -> Json:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": list(what),
        "key_exprs": list(keys),
    }
