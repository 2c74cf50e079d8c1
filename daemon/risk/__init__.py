"""Reads and writes what `safety.risk` calculates with: it must not touch files itself."""
