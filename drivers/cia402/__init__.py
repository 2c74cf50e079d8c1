"""Drives and motion control (CiA 402) on top of CANopen."""
