"""What may move: states, causes, limits, the gate and its permit. Pure: no I/O, no clock. Read
states, causes, gate, permit.
"""
