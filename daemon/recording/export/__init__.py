"""A recording as tables, for programs that know nothing of recordings."""
