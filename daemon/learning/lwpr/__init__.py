"""Locally weighted projection regression (Vijayakumar et al. 2005), compiled: read model first."""
