"""What holds for all tests."""

import pytest

RERUNS = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give tests in real time another try.

    They start processes that share the machine with everything else on it, and a machine that
    stands still for seconds is no defect of ours. What is broken fails every time.
    """
    for item in items:
        if item.get_closest_marker("hil") is not None:
            item.add_marker(pytest.mark.flaky(reruns=RERUNS))
