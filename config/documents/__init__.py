"""A YAML file as it was written: places, problems with them, and the base of all models."""
