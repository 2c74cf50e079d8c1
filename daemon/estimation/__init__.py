"""From measured poses to where the tip is: pose_filter while a robot runs, recorded_path after."""
