"""What speaks to devices: bytes and states without I/O, and the links that carry them."""
