"""Paths of the axes that lead the tip somewhere and keep the whole body away from everything."""
