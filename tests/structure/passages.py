"""What one tracker reply and one `start` pass through, noted while the daemon runs.

Run as a program beside a checkout (its root on PYTHONPATH, and as argument): it plays a scene with
the checkout's own rig, in virtual time, with learning on, and prints one JSON. A passage is the set
of the product's functions that are called, without those of the emulated devices:

- `tracker_reply`: from the call that hands a driver its bytes, until the clock moves on: the reply
  is read, the step decided, its targets written, and what happened published and recorded.
- `start`: from the operator's `handle` to its answer.

Compiled kernels are called by their wrappers and do not show.
"""

import asyncio
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

_ENTRY: Final = "bytes_received"
"""A driver's method that takes what came over a serial line."""
_SCENERY: Final = frozenset({"sim_backends", "tests"})
_CIRCLE: Final = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 10.0,
    "cycle_s": 20.0,
}
_LEARNER: Final = {"kind": "reward_weighted"}
_FOLLOWING_S: Final = 1.0
"""So far along the trajectory, the first motions are over and local models are asked."""
_LONGEST_S: Final = 120.0
_LOOK_EVERY_S: Final = 0.05
_TURNS: Final = 50
_NOTED_S: Final = 1.0


class Notes:
    """Which functions are called while somebody notes."""

    def __init__(self, root: Path) -> None:
        self._root = f"{root}/"
        self._floors: dict[CodeType, str] = {}
        self.called: set[tuple[str, str]] | None = None
        self.on_entry: Callable[[FrameType], None] = lambda _: None

    def profile(self, frame: FrameType, event: str, argument: object) -> None:
        del argument
        if event != "call":
            return
        code = frame.f_code
        floor = self._floors.get(code)
        if floor is None:
            floor = self._floors[code] = self._floor(code)
        if not floor:
            return
        if code.co_name == _ENTRY and floor == "drivers":
            self.on_entry(frame)
        if self.called is not None:
            self.called.add((code.co_filename, code.co_qualname))

    def _floor(self, code: CodeType) -> str:
        """The top-level package of a function; empty for what is not noted."""
        if code.co_name.startswith("<") or not code.co_filename.startswith(self._root):
            return ""
        top = code.co_filename.removeprefix(self._root).split("/")[0]
        return "" if top in _SCENERY or top.startswith(".") else top

    @contextmanager
    def noting(self) -> Iterator[set[tuple[str, str]]]:
        """What is called in here."""
        called: set[tuple[str, str]] = set()
        self.called = called
        try:
            yield called
        finally:
            self.called = None


class Replies:
    """Notes each reply from its bytes until the clock moves on."""

    def __init__(self, notes: Notes, loop: asyncio.AbstractEventLoop) -> None:
        self._notes = notes
        self._loop = loop
        self.passages: list[set[tuple[str, str]]] = []
        notes.on_entry = self._begin

    def _begin(self, frame: FrameType) -> None:
        del frame
        if self._notes.called is None:
            self._notes.called = set()
            self._loop.call_soon(self._look, self._loop.time(), 0)

    def _look(self, began_s: float, turns: int) -> None:
        """Go on while the clock stands still, for as many turns of the loop as a reply can need."""
        called = self._notes.called
        assert called is not None
        if self._loop.time() == began_s and turns < _TURNS:
            self._loop.call_soon(self._look, began_s, turns + 1)
            return
        self._notes.called = None
        self.passages.append(called)


def main(root: Path) -> int:
    """Play the scene, print what was noted."""
    rig = importlib.import_module(_rig_module(root))
    messages = importlib.import_module(_module_with(root, "class Start("))
    notes = Notes(root)
    found: dict[str, Any] = {}

    async def scene(daemon: Any) -> None:
        with suppress(Exception):
            warm = importlib.import_module(_module_with(root, "def warm_up() -> None:"))
            warm.warm_up()
        await daemon.armed()
        await daemon.do(messages.Load, trajectory=_CIRCLE, controller=_LEARNER)
        sys.setprofile(notes.profile)
        try:
            with notes.noting() as called:
                await daemon.do(messages.Start)
            found["start"] = _told(called, root)
            sys.setprofile(None)
            async with asyncio.timeout(_LONGEST_S):
                while _elapsed_s(daemon) <= _FOLLOWING_S:  # a whole status, each time
                    await asyncio.sleep(_LOOK_EVERY_S)
            replies = Replies(notes, asyncio.get_running_loop())
            sys.setprofile(notes.profile)
            await asyncio.sleep(_NOTED_S)
        finally:
            sys.setprofile(None)
        assert daemon.state.value == "running", daemon.causes
        found["tracker_reply"] = _usual(replies.passages, root)

    rig.on_a_rig(scene)
    print(json.dumps(found))
    return 0


def _elapsed_s(daemon: Any) -> float:
    status = daemon.service.status
    reference = (status() if callable(status) else status).reference
    return 0.0 if reference is None else float(reference.elapsed_s)


def _usual(passages: list[set[tuple[str, str]]], root: Path) -> dict[str, Any]:
    """The passage of median length, and of how many."""
    ordered = sorted(passages, key=len)
    usual = _told(ordered[len(ordered) // 2], root)
    return usual | {"noted": len(passages), "most_functions": len(ordered[-1])}


def _told(called: set[tuple[str, str]], root: Path) -> dict[str, Any]:
    files: dict[str, list[str]] = {}
    for path, name in sorted(called):
        files.setdefault(Path(path).relative_to(root).as_posix(), []).append(name)
    return {"files": len(files), "functions": len(called), "passed": files}


def _rig_module(root: Path) -> str:
    return _module_with(root / "tests", "def on_a_rig(", root)


def _module_with(folder: Path, text: str, root: Path | None = None) -> str:
    """The one module below a folder that has this text at the beginning of a line."""
    for path in sorted(folder.rglob("*.py")):
        relative = path.relative_to(root or folder)
        hidden = any(part.startswith(".") for part in relative.parts)
        if not hidden and any(line.startswith(text) for line in path.read_text().splitlines()):
            return ".".join(relative.with_suffix("").parts)
    raise LookupError(f"nothing below {folder} has {text!r}")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
