"""Bodies that are described by their robot files alone follow their circles, in virtual time."""

import pytest

from daemon.testing.labs import TestLab


@pytest.mark.parametrize("name", ["one_segment_circle", "three_tendon_circle"])
def test_it_follows_its_circle_to_a_millimetre(lab: TestLab, name: str) -> None:
    result = lab.run(f"builtin:{name}", trajectory={"cycle_s": 20.0, "cycles": 1})
    assert result.holds == 0
    assert result.cycle(1).mean_mm <= 1.0
    assert result.true_cycle(1).mean_mm <= 1.0
