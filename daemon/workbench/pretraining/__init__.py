"""Exploration of a robot, and the forward model made from it."""
