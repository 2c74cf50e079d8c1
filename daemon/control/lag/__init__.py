"""A body that answers late: how late, what it holds back in turns, what takes its tip off, and what
a path that is repeated taught of it."""
