"""Emulated CiA 402 drives."""
