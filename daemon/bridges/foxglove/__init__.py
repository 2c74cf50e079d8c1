"""Foxglove and Lichtblick: what the robot tells, drawn: live, or in a file. Needs foxglove-sdk."""
