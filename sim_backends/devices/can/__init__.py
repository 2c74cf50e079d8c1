"""A modelled CAN bus and the two ways into it."""
