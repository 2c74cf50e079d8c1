"""What tests of reports share."""

import pytest

from daemon.workbench.report import report


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and not drawn: for who looks at what a report says."""
    monkeypatch.setattr(report, "as_data_uri", lambda _: "data:image/svg+xml;base64,")
