"""Tests of what the shell gets from us."""
