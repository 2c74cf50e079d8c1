"""One Chromium for all tests of the page."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.page.browsing import CHROMIUM
from tests.page.stage import Stage, stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="session")
def browser() -> "Iterator[Browser]":
    """Skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
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
