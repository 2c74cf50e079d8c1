"""What people see of a robot in a terminal, and are told of its hardware by `probe`."""
