"""What may happen to a drive, decided without I/O, without a clock, without asyncio."""
