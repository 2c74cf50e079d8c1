"""Commands that tell what the robot tells to other programs, each in a process of its own."""
