"""How many examples a property is held against, on a machine that may stand still at any time."""

from hypothesis import HealthCheck, settings


def examples(number: int) -> settings:
    """So many, however long they take."""
    return settings(
        max_examples=number, deadline=None, suppress_health_check=[HealthCheck.too_slow]
    )
