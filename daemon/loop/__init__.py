"""One control step for every frame of the tracker: control_step, and how well it keeps its time."""
