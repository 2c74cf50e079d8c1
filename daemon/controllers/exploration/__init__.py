"""Motions that are made to learn from: each a controller that follows nothing."""
