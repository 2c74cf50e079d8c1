"""Controllers, plants and trajectories of installed packages: a good one, and the bad ones."""
