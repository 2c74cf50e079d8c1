"""What controllers share: the interface, the step from a Jacobian, avoidance, reachability."""
