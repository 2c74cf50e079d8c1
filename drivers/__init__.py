"""Bytes to values and back: the tracker, the bus and the drives. No controller is known here."""
