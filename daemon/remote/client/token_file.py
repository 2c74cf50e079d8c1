"""The lease that `tentacled lease` holds, for the same user's other commands."""

from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from daemon.files import write_whole

_NAME: Final = "lease.json"


class StoredLease(msgspec.Struct, frozen=True):
    """Whose, and with which token."""

    user: str
    token: str


def token_file(folder: Path, user: str) -> Path:
    """Where the lease of `user` is kept in `folder`."""
    return folder / f"{user}.{_NAME}"


def store_lease(path: Path, lease: StoredLease) -> None:
    """Keep it where nobody else can read it. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_whole(path, msgspec.json.encode(lease), 0o600)


def stored_token(path: Path) -> str:
    """The token that is kept there; empty where there is none."""
    with suppress(OSError, msgspec.MsgspecError):
        return msgspec.json.decode(path.read_bytes(), type=StoredLease).token
    return ""


def forget_lease(path: Path, token: str) -> None:
    """This one is not held any more; somebody else's that is kept there by now stays."""
    with suppress(OSError):
        if stored_token(path) not in ("", token):
            return
        path.unlink(missing_ok=True)
