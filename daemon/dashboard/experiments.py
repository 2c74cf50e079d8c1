"""Experiments that a page may load: those that are shipped, and those of a folder."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, get_args

from config.documents.model import OptionsError
from config.documents.yaml_document import read_yaml
from config.tasks.trajectory import load_trajectory_options

_NOT_ASKED: Final = frozenset({"kind", "file", "points"})
"""Of a trajectory: what is not a number or a choice that somebody would change on a page."""
_ANY: Final = ""
"""The controller that needs to know nothing."""


class ExperimentFiles:
    """Found anew at every question: files come and go."""

    def __init__(self, folder: Path | None = None) -> None:
        """folder: of the site's own, besides the shipped ones."""
        shipped = Path(str(files("config") / "experiments"))
        self._folders = [shipped] if folder is None else [shipped, folder]

    def offered(self, robot: str) -> list[dict[str, Any]]:
        """Name, trajectory and controller of all that are for `robot` and can be loaded."""
        return [
            {
                "name": name,
                "trajectory": content["trajectory"].get("kind", ""),
                "controller": (content.get("controller") or {}).get("kind", ""),
                "parameters": _parameters(content["trajectory"]),
            }
            for name, content in self._found(robot).items()
        ]

    def load(
        self, robot: str, name: str, parameters: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any] | None] | None:
        """Trajectory and controller; None where there is no such experiment for `robot`.

        parameters: of the trajectory, in place of the file's. The daemon checks their values; a
        name that the trajectory does not have raises ValueError.
        """
        content = self._found(robot).get(name)
        if content is None:
            return None
        known = {parameter["name"] for parameter in _parameters(content["trajectory"])}
        if unknown := sorted(set(parameters or {}) - known):
            raise ValueError(f"its trajectory has no {', '.join(unknown)}")
        return {**content["trajectory"], **(parameters or {})}, content.get("controller")

    def controllers(self, robot: str) -> list[dict[str, str]]:
        """Names and labels of what may follow a hand, for `controller`."""
        told = [{"name": _ANY, "label": "needs no model"}]
        for name, content in self._found(robot).items():
            kind = (content.get("controller") or {}).get("kind")
            if kind and not str(kind).endswith("exploration"):
                told.append({"name": name, "label": f"{kind}, as in {name}"})
        return told

    def controller(self, robot: str, name: str) -> dict[str, Any] | None:
        """The controller of an experiment; None: the one that needs to know nothing.

        Raises ValueError where there is no such experiment.
        """
        if name == _ANY:
            return None
        found = self._found(robot).get(name)
        if found is None:
            raise ValueError("there is no such experiment for this robot")
        controller: dict[str, Any] | None = found.get("controller")
        return controller

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


def _parameters(trajectory: dict[str, Any]) -> list[dict[str, Any]]:
    """Numbers and choices, with their values in the file or by default; empty: it is none. What is
    left open in the file is no number that somebody could change."""
    try:
        options = load_trajectory_options(trajectory)
    except OptionsError:
        return []
    told = []
    for name, field in type(options).model_fields.items():
        if name in _NOT_ASKED:
            continue
        parameter: dict[str, Any] = {"name": name, "value": getattr(options, name)}
        if parameter["value"] is None:
            continue
        if isinstance(parameter["value"], str):
            parameter["choices"] = list(get_args(field.annotation))
        told.append(parameter)
    return told


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
