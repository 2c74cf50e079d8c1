"""What stands in for the hardware: physics, devices that speak the real bytes, and their lab."""
