"""The schema that editors use is the one that the loader uses."""

import json
from importlib.resources import files
from pathlib import Path

from daemon.commands.host.schema import robot_schema

SHIPPED = Path(str(files("config") / "robot.schema.json"))


def test_the_shipped_schema_is_what_the_code_has() -> None:
    """If not: `tentacled schema > config/robot.schema.json`."""
    assert SHIPPED.read_text() == robot_schema() + "\n"


def test_every_key_is_described() -> None:
    """An editor can show what a key means; names that say it all are let off."""
    schema = json.loads(SHIPPED.read_text())
    plain = {"name", "kind", "node", "bus", "drive", "seed", "safe", "homing", "axes"}
    silent = [
        f"{title}.{key}"
        for title, part in schema["$defs"].items()
        for key, value in part.get("properties", {}).items()
        if "description" not in value and key not in plain
    ]
    assert len(silent) < 60, silent
