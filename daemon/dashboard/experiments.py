"""Experiments that a page may load: those that are shipped, and those of a folder."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from config.documents.yaml_document import read_yaml


class ExperimentFiles:
    """Found anew at every question: files come and go."""

    def __init__(self, folder: Path | None = None) -> None:
        """folder: of the site's own, besides the shipped ones."""
        shipped = Path(str(files("config") / "experiments"))
        self._folders = [shipped] if folder is None else [shipped, folder]

    def list(self, robot: str) -> list[dict[str, Any]]:
        """Name, trajectory and controller of all that are for `robot` and can be loaded."""
        return [
            {
                "name": name,
                "trajectory": content["trajectory"].get("kind", ""),
                "controller": (content.get("controller") or {}).get("kind", ""),
            }
            for name, content in self._found(robot).items()
        ]

    def load(self, robot: str, name: str) -> tuple[dict[str, Any], dict[str, Any] | None] | None:
        """Trajectory and controller; None where there is no such experiment for `robot`."""
        content = self._found(robot).get(name)
        return None if content is None else (content["trajectory"], content.get("controller"))

    def _found(self, robot: str) -> dict[str, dict[str, Any]]:
        found = {}
        for folder in self._folders:
            for path in sorted(folder.glob("*.yaml")):
                content = self._content(path)
                if content is not None and _is_for(content, path, robot):
                    found[path.stem] = content
        return found

    @staticmethod
    def _content(path: Path) -> dict[str, Any] | None:
        try:
            content = read_yaml(path).value
        except (OSError, ValueError):
            return None
        if not isinstance(content, dict) or not isinstance(content.get("trajectory"), dict):
            return None
        needs_model = content.get("pretraining") is not None
        reads_a_file = "file" in content["trajectory"]
        controller = content.get("controller")
        plain = controller is None or isinstance(controller, dict)
        return content if plain and not needs_model and not reads_a_file else None


def _is_for(content: dict[str, Any], path: Path, robot: str) -> bool:
    named = content.get("robot")
    if not isinstance(named, str):
        return True
    beside = path.parent / named
    if named.startswith("builtin:") or not beside.is_file():
        return Path(named.removeprefix("builtin:")).stem == robot
    try:
        told = read_yaml(beside).value
    except (OSError, ValueError):
        return False
    return isinstance(told, dict) and told.get("robot") == robot
