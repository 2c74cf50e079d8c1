"""How tests are given to workers: those of a file together, those of a long file one by one.

What a file makes for all of its tests is made once then, and not by each worker; and after every
test xdist looks through all the pieces that it has given out.
"""

from collections.abc import Mapping
from typing import Any, Final

import pytest
from xdist.scheduler import LoadGroupScheduling

from tests.quick.selection import MEASURED, read_measured

_LONG_S: Final = 4.0
"""Of a file: as one piece it might begin late, and keep one worker when others have ended."""
_IN_REAL_TIME: Final = ("tests/hil/", "tests/page/")
"""Nobody has measured these."""


class FileScheduling(LoadGroupScheduling):  # type: ignore[misc] # its library has no types
    """As xdist's `--dist loadgroup`, but for tests that name no group."""

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        self._seconds = read_measured(MEASURED.read_text())

    def _split_scope(self, nodeid: str) -> str:
        group: str = super()._split_scope(nodeid)
        return piece_of(nodeid, self._seconds) if group == nodeid else group


def piece_of(test: str, seconds: Mapping[str, float]) -> str:
    """The name of what goes to one worker. seconds: that each file takes, where it was measured."""
    file = test.partition("::")[0]
    alone = file.startswith(_IN_REAL_TIME) or seconds.get(file, 0.0) > _LONG_S
    return test if alone else file
