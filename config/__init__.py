"""What a robot, an experiment and a study are: schema, loader, and the shipped files."""
