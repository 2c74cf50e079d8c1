"""What an operator may ask of the robot, and one run of it from its start to its end."""
