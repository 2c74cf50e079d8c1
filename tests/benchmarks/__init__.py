"""Measurements: `python -m tests.benchmarks` prints one JSON. Nothing is asserted but that it ends.

Each part is a module with `measure(tiny)`, made of pieces (`timing.pieces`): a piece that fails is
reported as failed, and the others go on. Beside the figures of each piece stands how long a loop of
plain Python took just before and after it, so that a slow machine is told from slow code.
"""
