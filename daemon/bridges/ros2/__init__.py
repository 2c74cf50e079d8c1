"""ROS 2, over the wire that rmw_zenoh speaks: no ROS is needed here. Needs rosbags."""
