"""Where the body may be: the mixture, the network that gives it, and the shapes drawn from it."""
