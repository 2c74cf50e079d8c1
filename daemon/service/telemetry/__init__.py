"""What is said of the robot as it runs: status, events, its body."""
