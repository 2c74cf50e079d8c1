"""The pytest plug-in: fixtures `lab`, `live_lab`, `rig`, `seed` and `plant`.

It imports nothing of ours before a fixture is used: it is loaded into every pytest of the
environment, and whatever it imported would be imported before coverage is measured.
"""

from __future__ import annotations

import re
import shutil
from argparse import ArgumentTypeError
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from daemon.testing.labs import TestLab
    from daemon.testing.rig import RigClient

_LAB_FIXTURES = {"lab", "live_lab"}
_LABS: pytest.StashKey[list[TestLab]] = pytest.StashKey()
_MARKERS = (
    "tentacled_seeds(seeds, plants=1): run the test with seeds 1 to `seeds` (fixture `seed`) on "
    "the body of the file and on `plants` - 1 others of its design (fixture `plant`)",
    "tentacled_rig: this test moves a real robot; only with --tentacled-rig",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("tentacled", "tentacled: tracking tests")
    group.addoption(
        "--tentacled-seeds", type=_count, metavar="N", help="seeds of each test, instead of its own"
    )
    group.addoption(
        "--tentacled-plants",
        type=_count,
        metavar="N",
        help="bodies of each test, instead of its own",
    )
    group.addoption(
        "--tentacled-artifacts",
        metavar="DIR",
        help="where report and recording of tests are kept, a folder for each",
    )
    group.addoption(
        "--tentacled-keep",
        choices=("failed", "all", "none"),
        default="failed",
        help="of which tests they are kept (failed)",
    )
    group.addoption(
        "--tentacled-rig", metavar="ROBOT.yaml", help="the robot that rig tests may move"
    )
    group.addoption(
        "--tentacled-rig-yes",
        metavar="NAME",
        help="its name, typed by who stands beside it with the emergency stop in reach",
    )


def pytest_configure(config: pytest.Config) -> None:
    for marker in _MARKERS:
        config.addinivalue_line("markers", marker)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    marker = metafunc.definition.get_closest_marker("tentacled_seeds")
    if marker is None and not _LAB_FIXTURES & set(metafunc.fixturenames):
        return  # these names are common: they may be fixtures of somebody else's
    seeds, plants = (1, 1) if marker is None else _said(marker, metafunc.definition.nodeid)
    asked = metafunc.config.getoption("--tentacled-seeds")
    others = metafunc.config.getoption("--tentacled-plants")
    if _free(metafunc, "seed"):
        metafunc.parametrize("seed", range(1, 1 + (asked or seeds)))
    if _free(metafunc, "plant"):
        metafunc.parametrize("plant", range(others or plants))


def _said(marker: pytest.Mark, test: str) -> tuple[int, int]:
    """How many seeds and plants. Less of them than was meant would go unnoticed."""

    def said(seeds: int = 1, plants: int = 1) -> tuple[int, int]:
        return _count(str(seeds)), _count(str(plants))

    try:
        return said(*marker.args, **marker.kwargs)
    except (TypeError, ArgumentTypeError) as error:
        wrong = str(error).replace("_said.<locals>.said", marker.name)
        pytest.fail(f"{test}: {marker.name}(seeds, plants=1): {wrong}", pytrace=False)


def _count(text: str) -> int:
    """Raises ArgumentTypeError."""
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise ArgumentTypeError(f"{text!r} is no number from 1 on")
    return int(text)


def _free(metafunc: pytest.Metafunc, name: str) -> bool:
    """Whether the test asks for it, and nothing of its own says what it is."""
    for mark in metafunc.definition.iter_markers("parametrize"):
        names = mark.args[0] if mark.args else mark.kwargs.get("argnames", "")
        if name in (re.split(r"\s*,\s*", names) if isinstance(names, str) else names):
            return False
    # pytest tells nowhere else whose a fixture is: the last of its definitions is the one used.
    definitions = getattr(metafunc, "_arg2fixturedefs", {}).get(name, ())
    theirs = bool(definitions) and definitions[-1].func.__module__ != __name__
    return name in metafunc.fixturenames and not theirs


@pytest.fixture
def seed() -> int:
    """Of the experiment: 1, or those of the marker `tentacled_seeds` and of `--tentacled-seeds`."""
    return 1


@pytest.fixture
def plant() -> int:
    """Which body: 0 is that of the file, others are of its design (the same marker; or
    `--tentacled-plants`)."""
    return 0


@pytest.fixture
def lab(request: pytest.FixtureRequest, tmp_path: Path) -> TestLab:
    """An emulated laboratory in virtual time: `lab.run(experiment)` gives a `TrackingResult`."""
    return _lab(request, tmp_path, real_time=False)


@pytest.fixture
def live_lab(request: pytest.FixtureRequest, tmp_path: Path) -> TestLab:
    """The same with the devices in a process of their own, over ptys and sockets, in real time."""
    return _lab(request, tmp_path, real_time=True)


def _lab(request: pytest.FixtureRequest, folder: Path, *, real_time: bool) -> TestLab:
    from daemon.testing.labs import TestLab

    made = TestLab(request.path.parent, folder, real_time=real_time)
    request.node.stash.setdefault(_LABS, []).append(made)
    return made


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[RigClient]:
    """A client that holds the lease of a real robot's running daemon. Never by accident."""
    name = request.node.name
    if request.node.get_closest_marker("tentacled_rig") is None:
        pytest.fail(f"{name} uses `rig` and is not marked tentacled_rig", pytrace=False)
    file = request.config.getoption("--tentacled-rig")
    if not file:
        pytest.skip("it moves a real robot: --tentacled-rig ROBOT.yaml is not given")
    from daemon.testing.rig import RigClient, RigError

    try:
        client = RigClient(Path(file), request.config.getoption("--tentacled-rig-yes") or "")
    except RigError as error:
        pytest.skip(str(error))
    try:
        yield client
    finally:
        client.close()


# What is left of a test.


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    labs = item.stash.get(_LABS, [])
    # A fixture of theirs may run experiments too; where that fails there is no other report.
    tells = report.when == "call" or (report.when == "setup" and report.failed)
    if not tells or not labs:
        return report
    runs = [run for one in labs for run in one.runs]
    for run in runs:
        properties = [(f"tentacled.{run.name}.{key}", value) for key, value in run.properties()]
        item.user_properties += properties
        report.user_properties += properties
    kept = _kept(item, report.failed, [run.folder for run in runs])
    if report.failed and runs:
        text = "\n\n".join(run.explanation() for run in runs)
        report.sections.append(("tentacled", f"{text}\n\n{kept}".rstrip()))
    return report


def _kept(item: pytest.Item, failed: bool, folders: list[Path]) -> str:
    """Where the runs are kept, each with its report, or why they are not; empty: nobody wants it.

    A test fails or passes all the same.
    """
    root, which = (item.config.getoption(f"--tentacled-{name}") for name in ("artifacts", "keep"))
    if root is None or which == "none" or (which == "failed" and not failed):
        return ""
    from daemon.testing.labs import keep

    place = Path(root).absolute() / re.sub(r"[^\w.\[\]=-]+", "_", item.nodeid)
    try:
        shutil.rmtree(place, ignore_errors=True)
        for folder in folders:
            keep(folder, place / folder.name)
    except OSError as error:
        return f"not kept in {place}: {error}"
    return f"kept in {place}"
