"""How the source tree is cut: `python -m tests.structure` measures any checkout of it.

In order: `sources` reads files and functions, `imports` who imports whom and in which circles,
`passages` runs the daemon in virtual time and notes what a reply and a command pass through.
"""
