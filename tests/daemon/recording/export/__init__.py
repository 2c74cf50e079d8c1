"""Tests of the tables that recordings are exported as."""
