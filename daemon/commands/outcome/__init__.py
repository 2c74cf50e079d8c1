"""How a command ends: its exit code, what it found out, and why it could not."""
