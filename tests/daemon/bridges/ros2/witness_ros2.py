"""`python -m tests.daemon.bridges.ros2.witness_ros2 PORT FOLDER TOPIC=TYPE ...`: what ROBOTIS'
zenoh-ros2-sdk hears, which knows nothing of this project: one line of JSON for each message, until
its input is closed. FOLDER has the definitions of the messages, so that it fetches none.
"""

import json
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import zenoh_ros2_sdk.message_registry as registry
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Subscriber

_TELLING = threading.Lock()
"""Messages come on threads of the library's, several at a time."""


def tell(what: dict[str, Any]) -> None:
    with _TELLING:
        print(json.dumps(what), flush=True)


def plain(value: Any) -> Any:
    """As JSON has it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    return value


def write_definitions(folder: Path, kinds: list[str]) -> None:
    """Of the types, and of all that they are made of, as `.msg` files."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for kind in kinds:
        text, _ = store.generate_msgdef(kind, ros_version=2)
        first, *others = text.split("=" * 80 + "\n")
        parts = {kind: first}
        for other in others:
            name, _, body = other.partition("\n")
            package, _, short = name.removeprefix("MSG: ").rpartition("/")
            parts[f"{package.removesuffix('/msg')}/msg/{short}"] = body
        for name, body in parts.items():
            path = folder / f"{name}.msg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(body)


def main() -> None:
    port, folder = int(sys.argv[1]), Path(sys.argv[2])
    wanted = dict(word.split("=") for word in sys.argv[3:])
    write_definitions(folder, sorted(set(wanted.values())))
    registry.get_registry(str(folder))
    subscribers = []
    for topic, kind in wanted.items():

        def heard(message: Any, topic: str = topic) -> None:
            tell({"topic": topic, "message": plain(message)})

        subscribers.append(
            ROS2Subscriber(topic, kind, heard, router_ip="127.0.0.1", router_port=port)
        )
    session = subscribers[0].session_mgr
    for reply in session.liveliness.get("@ros2_lv/0/**", timeout=5.0):
        if reply.ok is not None:
            tell({"token": str(reply.ok.key_expr)})
    sys.stdin.read()
    for one in subscribers:
        one.close()


if __name__ == "__main__":
    main()
