"""Commands for what was recorded: reports, what a crash has left, and tables for other programs."""
