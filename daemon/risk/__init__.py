"""The running daemon's risk: model and surface from files, and the source that the gate asks."""
