"""Places to write where the installation and the home folder are read-only.

Compiled kernels, distance grids and models are kept between starts: beside the installation or in
the home folder. Where nobody may write there, a folder of the user's own in the one for temporary
files has to do; child processes hear of it by the environment.
"""

import os
import stat
import tempfile
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).parents[2]
"""Where our packages are installed."""
_KERNELS: Final = _ROOT / "sim_backends" / "plants"
_OURS_ALONE: Final = 0o700

_NUMBA: Final = "NUMBA_CACHE_DIR"
_HOMES: Final = {
    "XDG_CACHE_HOME": ".cache",
    "XDG_DATA_HOME": ".local/share",
    "MPLCONFIGDIR": ".config/matplotlib",
}
"""What names each place, and where in the home folder it is by default. matplotlib complains at
every start where it has none for its settings."""


def ensure_writable_places(environment: MutableMapping[str, str] = os.environ) -> list[str]:
    """Name other places for those that cannot be written to and that nobody has named.

    Returns the variables that were set. It looks at folders and makes one at most.
    """
    home = Path(environment.get("HOME") or _home())
    missing = {
        variable: name
        for variable, name in _HOMES.items()
        if not environment.get(variable) and not _can_be_made(home / name)
    }
    # numba's own second choice, after the folder of the source, is the cache folder.
    beside = _can_be_made(_KERNELS / "__pycache__")
    if "XDG_CACHE_HOME" in missing and not beside and not environment.get(_NUMBA):
        missing[_NUMBA] = "numba"
    if missing:
        place = own_temporary_folder()
        for variable, name in missing.items():
            environment[variable] = str(place / name)
    return list(missing)


def kernels_are_kept(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether what is compiled is there at the next start: in the first of numba's own places."""
    home = Path(environment.get("HOME") or _home())
    cache = Path(environment.get("XDG_CACHE_HOME") or home / _HOMES["XDG_CACHE_HOME"])
    if named := environment.get(_NUMBA):
        return _can_be_made(Path(named))
    return _can_be_made(_KERNELS / "__pycache__") or _can_be_made(cache)


def _home() -> str:
    try:
        return str(Path.home())
    except RuntimeError:  # a user whom the system does not know
        return "/nonexistent"


def _can_be_made(folder: Path) -> bool:
    """Whether files can be written in it, as it is or once it is made."""
    for place in (folder, *folder.parents):
        if place.exists():
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def own_temporary_folder() -> Path:
    """The same one at each start, unless somebody else has put something there: then a new one."""
    place = Path(tempfile.gettempdir()) / f"tentacled-kept-{os.getuid()}"
    try:
        place.mkdir(mode=_OURS_ALONE)
    except OSError:
        if not _is_ours(place):
            return Path(tempfile.mkdtemp(prefix="tentacled-"))
    return place


def _is_ours(place: Path) -> bool:
    """Whether nobody else can have put anything into it: compiled code is run as it is found."""
    try:
        found = place.lstat()
    except OSError:
        return False
    private = stat.S_IMODE(found.st_mode) & ~_OURS_ALONE == 0
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and private
