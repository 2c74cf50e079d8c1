"""What is round the body, cut into parts that messages hold."""

import hashlib
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from daemon.messages import Surroundings

_PART_BYTES: Final = 49152
_IDENTITY: Final = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]


class PreparedSurroundings(NamedTuple):
    """Made once, so that a question for them costs the loop nothing."""

    about: Surroundings
    parts: Sequence[bytes]


def cut_surroundings(
    name: str,
    stl: bytes,
    workspace_mm: list[list[float]] | None,
    counts_sha256: str = "",
    regions: Sequence[dict[str, Any]] = (),
    port: dict[str, Any] | None = None,
) -> PreparedSurroundings:
    """name: of the mesh's file. stl: in the base sensor's frame; empty: nobody knows it.

    workspace_mm: (3, 2); None: it is not bounded. counts_sha256, regions, port: as `Surroundings`
    has them.
    """
    parts = [stl[begin : begin + _PART_BYTES] for begin in range(0, len(stl), _PART_BYTES)]
    about = Surroundings(
        mesh=name,
        sha256=hashlib.sha256(stl).hexdigest() if stl else "",
        size_bytes=len(stl),
        parts=len(parts),
        transform=_IDENTITY,
        workspace_mm=workspace_mm,
        counts_sha256=counts_sha256,
        regions=list(regions),
        port=port,
    )
    return PreparedSurroundings(about, parts)
