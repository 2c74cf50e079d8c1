"""The page of figures of a recorded run."""
