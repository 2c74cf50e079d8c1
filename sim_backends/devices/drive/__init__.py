"""An emulated CANopen drive: `node` speaks CiA 301, `axis` is the motor of CiA 402, drive joins
them.
"""
