"""A node of the ROS graph that publishes what the robot tells, in a zenoh session of its own."""

import json
from typing import Final

import zenoh

from daemon.bridges.ros2.graph import Node, attachment, publisher_identifier
from daemon.bridges.ros2.translation import RosTranslation, Told
from daemon.host.clock import MonotonicClock
from daemon.messages import Message, Surroundings, WhoAmI

ROUTER: Final = "tcp/localhost:7447"
"""Where rmw_zenoh's router listens, unless it is told otherwise."""


class RosPublisher:
    """Implements a bridge's listener. It never joins the daemon's own session, which has rules of
    access that ROS knows nothing of."""

    def __init__(
        self, robot: str, domain: int, endpoint: str, *, distro: str = "jazzy", router: bool = False
    ) -> None:
        """endpoint: of the router; with `router`, where this one listens in its place. Raises
        ValueError, and zenoh.ZError where the endpoint cannot be had."""
        self._translation = RosTranslation(robot, distro)
        topics = self._translation.topics()
        Node(domain, "0", f"tentacled_{robot}")  # wrong words are told before a session is there
        self._session = zenoh.open(_config(endpoint, router))
        self._clock = MonotonicClock()
        node = Node(domain, str(self._session.info.zid()), f"tentacled_{robot}")
        liveliness = self._session.liveliness()
        self._tokens = [liveliness.declare_token(node.token)]
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._identifiers: dict[str, bytes] = {}
        self._numbers = dict.fromkeys(topics, 0)
        for entity, (name, topic) in enumerate(topics.items(), start=1):
            token = node.publisher_token(entity, topic)
            self._publishers[name] = self._session.declare_publisher(
                topic.key(domain),
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )
            self._identifiers[name] = publisher_identifier(token)
            self._tokens.append(liveliness.declare_token(token))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:
        self._translation.connected(me, surroundings, mesh)

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        """Nothing of them is told."""

    def heard(self, message: Message, date_ns: int) -> None:
        for told in self._translation.told(message, date_ns):
            self._publish(told)

    def lost(self, why: str) -> None:
        for told in self._translation.lost(why, self._clock.wall_time_ns()):
            self._publish(told)

    def _publish(self, told: Told) -> None:
        name, cdr, date_ns = told
        self._numbers[name] += 1
        more = attachment(self._numbers[name], date_ns, self._identifiers[name])
        self._publishers[name].put(cdr, attachment=more)


def _config(endpoint: str, router: bool) -> zenoh.Config:
    config = zenoh.Config()
    values = {
        "mode": "router" if router else "peer",
        "connect/endpoints": [] if router else [endpoint],
        "listen/endpoints": [endpoint] if router else [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config
