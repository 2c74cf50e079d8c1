"""The page is what the code is: whoever changes what is promised sees it in a diff."""

import subprocess
import sys
from pathlib import Path

import pytest

from daemon import api
from tests.daemon.api.reference import reference

ROOT = Path(__file__).parents[3]


PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


def promises(page: str) -> dict[str, dict[str, list[str]]]:
    """By section and member: its arguments or fields, `=` behind what may be left out."""
    found: dict[str, dict[str, list[str]]] = {}
    for section in page.split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        members = found.setdefault(title.strip(), {})
        code = "".join(body.split("```python\n")[1:]).partition("```")[0].splitlines()
        for line in code or [one for one in body.splitlines() if one.startswith("- ")]:
            if line.startswith("- "):
                name, _, rest = line.partition(": ")
            else:
                name, _, rest = line.partition("  #")[0].partition("(")
            parts = [part.strip() for part in rest.rstrip(")").split(",") if part.strip()]
            members[name] = [part.replace(" ", "").removesuffix("...") for part in parts]
    return found


def test_what_is_promised_is_kept() -> None:
    """What is only added may be added to the page: `python -m tests.daemon.api.reference >
    docs/api.md`. What is changed or taken away raises `API_VERSION`, too."""
    now = promises(reference())
    promised = promises(PAGE)
    assert f"Version {api.API_VERSION}." in PAGE
    assert len(promised["messages"]) > 30
    for section, members in promised.items():
        for member, parts in members.items():
            assert member in now[section], f"{section}: {member} is gone"
            found = now[section][member]
            assert [one for one in found if one in parts] == parts, f"{section}: {member}"
            added = [one for one in found if one not in parts and one != "*"]
            assert all(one.endswith("=") for one in added), f"{section}: {member} needs {added}"


def test_a_breach_is_noticed() -> None:
    gone = PAGE.replace(
        "load(trajectory, controller=...", "load(trajectory, colour, controller=..."
    )
    assert gone != PAGE
    assert promises(gone)["BlockingRobotClient"]["load"] == [
        "trajectory",
        "colour",
        "controller=",
        "cycles=",
    ]


def test_every_name_is_there_and_no_other() -> None:
    assert sorted(api.__all__) == sorted({*api._HOMES, "API_VERSION", "messages"})
    for name in api.__all__:
        assert getattr(api, name) is not None
    with pytest.raises(AttributeError, match="has no Nothing"):
        _ = api.Nothing


def test_a_controller_is_written_without_the_workbench_torch_or_a_wire() -> None:
    code = (
        "import sys\n"
        "from daemon.api import Controller, Kind, Proposal, TipFollower, TipFollowing\n"
        "names = ('daemon.workbench', 'torch', 'matplotlib', 'zenoh', 'daemon.testing')\n"
        "print([name for name in sys.modules if name.startswith(names)])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
