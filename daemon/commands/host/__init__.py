"""Commands that start something, or look at what this machine has."""
