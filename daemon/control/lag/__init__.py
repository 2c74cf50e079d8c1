"""A body that answers late: how late, what it holds back in turns, and what takes its tip off."""
