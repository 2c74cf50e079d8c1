"""What is learnt once for these tests."""

import pytest

from tests.daemon.control.closed_loop import pretrained


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)
