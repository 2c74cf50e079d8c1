"""One emulated axis (CiA 402): power states, modes of operation, and the shaft they move."""
