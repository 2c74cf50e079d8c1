"""Reward-weighted local inverse controllers (Ho et al. 2018) over a window: local_controllers, then
the engines.
"""
