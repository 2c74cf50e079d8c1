"""Measurements: `python -m tests.benchmarks` prints one JSON. Nothing is asserted."""
