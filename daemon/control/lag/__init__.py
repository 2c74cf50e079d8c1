"""A body that answers late: how late it is, and what takes its tip off meanwhile."""
