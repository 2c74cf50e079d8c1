"""Composition: the step, the services around it, and the command line. Only here parts meet."""
