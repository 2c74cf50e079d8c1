"""What is wrong, and what follows: conditions become causes, causes become states and power."""
