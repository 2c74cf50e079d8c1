"""The long checks: `make experiments`."""
