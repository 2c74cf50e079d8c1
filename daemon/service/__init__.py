"""One robot under an operator's control: devices, loop, commands, events and status together."""
