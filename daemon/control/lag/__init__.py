"""A body that answers late: how late it is, what takes it off meanwhile, and leading it by that."""
