"""Commands that explore, learn, carry out experiments, and evaluate what was recorded."""
