"""Physics only: actuator positions and load in, body shape and forces out."""
