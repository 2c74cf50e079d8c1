"""How much room there is for recordings."""

import shutil
from pathlib import Path
from typing import Final

_BYTES_PER_MB: Final = 1_000_000


def free_mb(folder: Path) -> float | None:
    """Room on the disk under a folder, which need not exist yet. None: cannot be told."""
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free / _BYTES_PER_MB
        except FileNotFoundError:
            continue
        except OSError:
            return None
    return None
