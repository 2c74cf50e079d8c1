"""Where the tip should be: trajectories from files, and the reference that follows them in time."""
