"""Long courses over time with fewer points: a figure shows no more of them than it has columns."""

import numpy as np

from daemon.workbench.report.report_table import Array

COLUMNS_PER_IN = 100
"""Of a figure's width: finer than a line is wide."""


def course(t_s: Array, values: Array, width_in: float) -> tuple[Array, Array]:
    """The course (n,) for a panel so wide: of each column its lowest and highest value, in their
    order. Short ones come back as they are; columns where all is nan stay gaps."""
    columns = round(width_in * COLUMNS_PER_IN)
    each = -(-len(values) // columns)
    if each <= 2:
        return t_s, values
    whole = len(values) // each * each
    table = values[:whole].reshape(-1, each)
    lowest = np.where(np.isnan(table), np.inf, table).argmin(axis=1)
    highest = np.where(np.isnan(table), -np.inf, table).argmax(axis=1)
    first = np.arange(0, whole, each)
    kept = np.stack([first + np.minimum(lowest, highest), first + np.maximum(lowest, highest)], 1)
    places = np.concatenate([[0], kept.ravel(), np.arange(whole, len(values))])
    places = np.unique(places)
    return t_s[places], values[places]
