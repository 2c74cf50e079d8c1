"""What others build on: written down, and the same as yesterday."""
