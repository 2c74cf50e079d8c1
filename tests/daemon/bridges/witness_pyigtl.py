"""`python -m tests.daemon.bridges.witness_pyigtl PORT DEVICE ...`: what pyigtl's own client hears.

One line of JSON for each device's newest message, again and again, until its input is closed.
"""

import json
import sys
import threading
from typing import Any

import pyigtl


def told(message: Any) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "kind": message.message_type,
        "device": message.device_name,
        "date_s": message.timestamp,
    }
    if message.message_type == "TRANSFORM":
        fields["matrix"] = message.matrix.tolist()
    elif message.message_type == "STRING":
        fields["text"] = message.string
    elif message.message_type == "POINT":
        fields["places_mm"] = [list(place) for place in message.positions]
        fields["diameters_mm"] = list(message.diameters)
    return fields


def main() -> None:
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", int(sys.argv[1]))
    ended = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    while not ended.is_set():
        for device in sys.argv[2:]:
            message = client.wait_for_message(device, timeout=0.5)
            if message is not None:
                print(json.dumps(told(message)), flush=True)
    client.stop()


if __name__ == "__main__":
    main()
