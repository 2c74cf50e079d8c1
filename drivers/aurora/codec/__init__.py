"""The Aurora's bytes and what they mean, without I/O: commands out, replies in."""
