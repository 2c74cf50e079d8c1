"""Files that clients send in parts: collected, measured, and kept until they are wanted."""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from daemon.messages import Upload
from daemon.risk.mesh_file import SUFFIXES
from daemon.service.motion_loader import CommandRefusedError, OffTheLoop

MOST_BYTES: Final = 32 << 20
"""Of one file: 300 000 triangles as binary STL are 15 MB, as text 80."""
MOST_PART_BYTES: Final = 49152
_MOST_FILES: Final = 32
"""That are kept; the one that was wanted longest ago goes first."""
_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,99}")
_SHA256: Final = re.compile(r"[0-9a-f]{64}")


class _Coming:
    """A file that has not come whole yet."""

    def __init__(self, name: str, size_bytes: int) -> None:
        self.name = name
        self.size_bytes = size_bytes
        self.parts: list[bytes] = []
        self.come_bytes = 0
        self.digest = hashlib.sha256()

    def add(self, part: bytes) -> None:
        """Measured part by part: all of it at once would hold the loop."""
        self.parts.append(part)
        self.come_bytes += len(part)
        self.digest.update(part)


class Uploads:
    """Of all users, each of whom sends one file at a time."""

    def __init__(self, folder: Callable[[], Path], off_the_loop: OffTheLoop) -> None:
        """folder: where whole files are kept. off_the_loop: how they get there."""
        self._folder = folder
        self._off_the_loop = off_the_loop
        self._coming: dict[str, tuple[str, _Coming]] = {}
        """By user: what its hash shall be, and what there is of it."""
        self._there: dict[str, Path] = {}
        """By hash."""

    async def take(self, user: str, part: Upload) -> str:
        """In words, what there is. Raises CommandRefusedError: the file is to be begun anew."""
        wrong = _wrong(part)
        if wrong is not None:
            self._coming.pop(user, None)
            raise CommandRefusedError(*wrong)
        coming = self._expected(user, part)
        coming.add(part.data)
        if coming.come_bytes < coming.size_bytes:
            return f"{coming.come_bytes} of {coming.size_bytes} bytes"
        del self._coming[user]
        if coming.digest.hexdigest() != part.sha256:
            text = f"{part.name} has come with the SHA-256 {coming.digest.hexdigest()}"
            raise CommandRefusedError("wrong_hash", f"{text}, not {part.sha256}: send it again")
        path = self._folder() / part.sha256 / coming.name
        try:
            await self._off_the_loop(lambda: _write(path, coming.parts))
        except (OSError, TimeoutError) as error:
            raise CommandRefusedError("not_kept", f"it cannot be kept: {error}") from None
        unwanted = self._keep(part.sha256, path)
        await self._off_the_loop(lambda: _remove(unwanted))
        return f"{coming.name} is there"

    def path(self, sha256: str) -> Path:
        """Where the file with this hash is. Raises CommandRefusedError where it has not come."""
        if sha256 in self._there:
            self._there[sha256] = path = self._there.pop(sha256)
            return path
        for expected, coming in self._coming.values():
            if expected == sha256:
                raise CommandRefusedError(
                    "upload_incomplete",
                    f"{coming.name} was cut off: {coming.come_bytes} of {coming.size_bytes} bytes "
                    "have come",
                )
        raise CommandRefusedError("no_such_upload", f"nothing was uploaded as {sha256[:80]}")

    def _expected(self, user: str, part: Upload) -> _Coming:
        """What this part goes on with. Raises CommandRefusedError."""
        if part.offset == 0:
            coming = _Coming(part.name, part.size_bytes)
            self._coming[user] = part.sha256, coming
            return coming
        sha256, there = self._coming.get(user, ("", None))
        if there is None or (sha256, there.size_bytes) != (part.sha256, part.size_bytes):
            raise CommandRefusedError("no_such_upload", f"{part.name} was not begun: begin at 0")
        if part.offset != there.come_bytes:
            text = f"this part begins at {part.offset}, and {there.come_bytes} bytes have come"
            raise CommandRefusedError("wrong_offset", text)
        return there

    def _keep(self, sha256: str, path: Path) -> list[Path]:
        """Returns the files that have to go: the same under another name, and the oldest. What is
        in use is mapped into memory, and needs no file."""
        before = self._there.pop(sha256, path)
        unwanted = [] if before == path else [before]
        self._there[sha256] = path
        while len(self._there) > _MOST_FILES:
            unwanted.append(self._there.pop(next(iter(self._there))))
        return unwanted


def _wrong(part: Upload) -> tuple[str, str] | None:
    """Why a part is none, with a name for it; None: it is one."""
    if not _NAME.fullmatch(part.name) or Path(part.name).suffix.lower() not in SUFFIXES:
        return "bad_mesh", f"the name of a mesh ends with {', '.join(SUFFIXES)}, and has no folder"
    if not _SHA256.fullmatch(part.sha256):
        return "wrong_hash", "sha256: 64 hexadecimal digits"
    if part.size_bytes > MOST_BYTES:
        text = (
            f"{part.name}: {part.size_bytes} bytes are more than {MOST_BYTES}: take triangles out"
        )
        return "too_large", f"{text}, or send it as binary STL or PLY"
    if not 0 < len(part.data) <= MOST_PART_BYTES:
        return "bad_payload", f"a part has 1 to {MOST_PART_BYTES} bytes, not {len(part.data)}"
    if part.offset < 0 or part.offset + len(part.data) > part.size_bytes:
        return "wrong_offset", f"{part.name} has {part.size_bytes} bytes, and this part goes beyond"
    return None


def _remove(paths: list[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)


def _write(path: Path, parts: list[bytes]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.writelines(parts)
