"""The machine below: clock, the bus cycle's timer, real-time rights, processes and signals."""
