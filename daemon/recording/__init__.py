"""The flight recorder, and runs on disk: written by a process of its own, read, and made whole."""
