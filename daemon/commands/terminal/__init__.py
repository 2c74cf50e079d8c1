"""The command line itself, and what its commands show and ask for in common."""
