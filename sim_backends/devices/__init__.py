"""Emulated devices. They speak the real bytes and know neither the plant nor a controller."""
