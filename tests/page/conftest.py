"""One Chromium for all tests of the page."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.page.browsing import CHROMIUM
from tests.page.stage import Stage, stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def _at_an_ordinary_priority(chromium: str, folder: Path) -> str:
    """A command that starts it so that it cannot raise its own priority.

    As root it does, by 8 steps of nice. Where it draws without a graphics card, the daemon's
    control loop then comes too late beside it, unlike beside an ordinary user's browser.
    """
    setpriv = shutil.which("setpriv")
    if os.geteuid() != 0 or setpriv is None:
        return chromium
    started = folder / "chromium"
    drop = "--bounding-set=-sys_nice --inh-caps=-sys_nice"
    started.write_text(f'#!/bin/sh\nexec {setpriv} {drop} {chromium} "$@"\n')
    started.chmod(0o755)
    return str(started)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[Browser]":
    """Skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    api = pytest.importorskip("playwright.sync_api")
    path = _at_an_ordinary_priority(CHROMIUM, tmp_path_factory.mktemp("browser"))
    with api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield launched
        launched.close()


@pytest.fixture(scope="session")
def _stage(browser: "Browser") -> Iterator[Stage]:
    del browser  # before anything is started: without one there is nothing to be seen
    with stage() as one:
        yield one


@pytest.fixture
def on(_stage: Stage) -> Stage:
    """A robot and the page's server, as they were at first."""
    _stage.begin_anew()
    return _stage
