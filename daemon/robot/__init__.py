"""The robot as the daemon has it: its file checked, its devices connected, its axes as arrays."""
