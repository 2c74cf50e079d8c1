"""Worst cases of the lengths of frames, as published."""

import pytest

from drivers.can.frame import worst_case_bits


@pytest.mark.parametrize(
    ("data_bytes", "bits"),
    [(0, 55), (1, 65), (2, 75), (4, 95), (6, 115), (7, 125), (8, 135)],
)
def test_worst_cases_with_11_bit_identifiers(data_bytes: int, bits: int) -> None:
    assert worst_case_bits(data_bytes) == bits


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 80), (8, 160)])
def test_worst_cases_with_29_bit_identifiers(data_bytes: int, bits: int) -> None:
    assert worst_case_bits(data_bytes, extended=True) == bits
