"""CANopen (CiA 301) as pure bytes and state machines."""
