"""Writes the pages of `docs/reference` from the code: `python -m tests.docs.reference`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from safety.causes import causes_as_markdown
from tests.docs.reference.commands import commands_page
from tests.docs.reference.faults import faults_page
from tests.docs.reference.files import configuration_page, kinds_page
from tests.docs.reference.wire import messages_page

FOLDER: Final = Path(__file__).parents[3] / "docs" / "reference"
COMMAND: Final = "python -m tests.docs.reference"
"""What renews them."""
_END: Final = f"\n---\n\nMade from the code: `{COMMAND}`.\n"
_CAUSES: Final = """\
# Causes

Everything that can be wrong, worst first. "After" is how long it has to last; "goes" is what makes
the reason go away once the cause is gone. What to do with one:
[Operate](../operate.md#reasons-and-remedies).

"""


def causes_page() -> str:
    """The table of all that can be wrong."""
    return _CAUSES + causes_as_markdown()


PAGES: Final[Mapping[str, Callable[[], str]]] = {
    "causes": causes_page,
    "commands": commands_page,
    "configuration": configuration_page,
    "faults": faults_page,
    "kinds": kinds_page,
    "messages": messages_page,
}


def page(name: str) -> str:
    """A page as it has to be."""
    return PAGES[name]() + _END
