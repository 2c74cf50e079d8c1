"""Who may watch the robot and command it, and over what."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from config.documents.model import ConfigModel, Name

Role = Literal["operator", "viewer"]
"""An operator may command; a viewer sees what the robot tells of itself."""

LOCAL_USER = "local"
"""Everybody who can open the unix socket. An operator."""

Endpoint = Annotated[
    str, StringConstraints(pattern=r"^([A-Za-z0-9._-]+|\[[0-9A-Fa-f:]+\]):[0-9]{1,5}$")
]


class TlsListener(ConfigModel):
    """For other machines: both sides show certificates. `tentacled certificates` makes them."""

    endpoint: Endpoint
    """Address to listen on, and port: `192.168.1.10:7448`."""

    stop_endpoint: Endpoint | None = None
    """Where nothing but STOP is taken, so that nothing else can be in its way; None: the same
    address, and the port after the other one."""

    certificates: str
    """Folder with `ca.pem`, `server.pem` and `server.key`, seen from the robot file."""

    @model_validator(mode="after")
    def _a_port(self) -> "TlsListener":
        for endpoint in (self.endpoint, self.stops_at):
            if not 1 <= int(endpoint.rpartition(":")[2]) <= 65535:
                raise ValueError("the port is 1 to 65535, and the next one is STOP's")
        if self.endpoint == self.stop_endpoint:
            raise ValueError("stop_endpoint: STOP has a port of its own")
        return self

    @property
    def stops_at(self) -> str:
        """Where STOP is taken."""
        return self.stop_endpoint or endpoint_after(self.endpoint)


def endpoint_after(endpoint: str) -> str:
    """The same address, and the next port."""
    host, _, port = endpoint.rpartition(":")
    return f"{host}:{int(port) + 1}"


class Remote(ConfigModel):
    """The daemon's ears. Without `tls` it can be reached from its own machine only."""

    unix_socket: bool = True
    """For programs on this machine that run as the daemon's user."""

    unix_socket_path: Annotated[str, StringConstraints(min_length=1)] | None = None
    """Where it is; None: `zenoh.sock` in the robot's runtime folder."""

    group_may_connect: bool = False
    """Whether the daemon's group may use the unix socket too."""

    tls: TlsListener | None = None
    users: dict[Name, Role] = Field(default_factory=dict)
    """Who may come over `tls`: the common name of each one's certificate, and the role."""

    @model_validator(mode="after")
    def _somebody_for_each_listener(self) -> "Remote":
        if LOCAL_USER in self.users:
            raise ValueError(f"users: '{LOCAL_USER}' is whoever uses the unix socket")
        if self.tls is not None and not self.users:
            raise ValueError("users: without any, nobody could come over tls")
        if self.tls is None and self.users:
            raise ValueError("users: they come over tls, which is not there")
        return self

    def role(self, user: str) -> Role | None:
        """What `user` may do; None: nothing."""
        if user == LOCAL_USER:
            return "operator" if self.unix_socket else None
        return self.users.get(user)
