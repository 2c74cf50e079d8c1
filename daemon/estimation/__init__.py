"""From measured poses to where the tip is: read constant_velocity, then pose_filter."""
