"""What is learnt from motions; pure arrays, no clock and no devices."""
