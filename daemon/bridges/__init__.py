"""Bridges: what the robot tells, in other programs' own languages. Each is an optional process and
an ordinary client of the daemon, and goes one way: out. None of them ever commands."""
