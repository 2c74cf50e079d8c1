"""NDI Aurora over a serial line (Combined API)."""
