"""Who may ask what of the page's server: rules without a server, each for an attack that was seen.

Every request passes `Rules.refusal` before anything else is done with it.
"""

import base64
import hashlib
import hmac
from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

from daemon.remote.access import OPERATOR

LOOPBACK_HOSTS: Final = ("127.0.0.1", "localhost", "[::1]")
LARGEST_BODY_BYTES: Final = 262144
VIEWER: Final = "viewer"
IMPORT_MAP: Final = '{"imports":{"three":"./static/vendor/three/three.core.js"}}'
"""The one thing that stands in the page itself: three's own modules ask for `three` by name."""
_JSON: Final = "application/json"
_READS: Final = frozenset({"GET", "HEAD"})


class Asked(NamedTuple):
    """What a rule may look at of a request. Nothing of it is what a proxy says of somebody else."""

    method: str
    path: str
    headers: Mapping[str, str]
    """Names in lower case."""
    cookies: Mapping[str, str]
    websocket: bool = False


class Refused(NamedTuple):
    """Why a request is not answered."""

    status: int
    text: str


class Rules:
    """For one server."""

    def __init__(
        self, port: int, hosts: Collection[str], tokens: Mapping[str, str], secure: bool = False
    ) -> None:
        """hosts: names by which the server may be asked. tokens: role by token; empty: somebody
        before the server lets only operators through. secure: it is reached by https."""
        self._hosts = {f"{host}:{port}".lower() for host in hosts}
        scheme = "https" if secure else "http"
        if port == (443 if secure else 80):
            self._hosts |= {host.lower() for host in hosts}
        self._origins = {f"{scheme}://{host}" for host in self._hosts}
        self._tokens = dict(tokens)
        self.secure: Final = secure
        self.cookie: Final = f"tentacled_{port}"
        """Cookies do not know ports: another server's on this machine must not be ours."""

    def refusal(self, asked: Asked) -> Refused | None:
        """Why not; None: it may be answered."""
        host, origin = asked.headers.get("host", "").lower(), asked.headers.get("origin")
        if host not in self._hosts:
            return Refused(403, "this server does not go by that name: start it with --host")
        if origin is not None and origin.lower() not in self._origins:
            return Refused(403, "another site's page may not ask here")
        if asked.method not in _READS and asked.method != "POST":
            return Refused(405, "there are only GET and POST")
        writes = asked.method == "POST"
        if (writes or asked.websocket) and origin is None:
            return Refused(403, "a browser says where a request comes from, and this does not")
        if writes:
            kind = asked.headers.get("content-type", "").split(";")[0].strip().lower()
            if kind != _JSON:
                return Refused(415, f"a request that does something is {_JSON}")
        return None

    def role(self, asked: Asked) -> str | None:
        """What whoever asks may do; None: it is nobody."""
        if not self._tokens:
            return OPERATOR
        return self.role_of(asked.cookies.get(self.cookie, ""))

    def role_of(self, token: str) -> str | None:
        """What the bearer of a token may do. Takes as long for a wrong one."""
        found = None
        for known, role in self._tokens.items():
            if hmac.compare_digest(known.encode(), token.encode("utf-8", "replace")):
                found = role
        return found


def may(role: str | None, action: str) -> bool:
    """Whether a role may do something: viewers do nothing but stop."""
    return role == OPERATOR or (role == VIEWER and action == "stop")


def security_headers() -> dict[str, str]:
    """Of every answer."""
    digest = base64.b64encode(hashlib.sha256(IMPORT_MAP.encode()).digest()).decode()
    policy = (
        "default-src 'none'",
        f"script-src 'self' 'sha256-{digest}'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "worker-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
    return {
        "Content-Security-Policy": "; ".join(policy),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-cache",
    }
