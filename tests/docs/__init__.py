"""README and docs/: what they say is run, checked, or made from the code."""
