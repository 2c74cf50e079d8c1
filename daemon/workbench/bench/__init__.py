"""The bench: from a study's cells and runs to who wins where, and the search that tunes for it."""
