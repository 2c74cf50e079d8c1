"""Steering by hand: from what an input device says to set-points. Sends nothing itself.

Read in this order: `input_events` (the kernel's bytes to reports), `devices` (what a report means
for a hand), `hand` (dead-man, clutch, scale: where the tip is asked to be), `station` (all of it
together, and a journal of what goes in, to be replayed to the last bit). `hid_device` is the edge:
it alone opens files.
"""
