"""`tentacled bridge`: the robot told to other programs, in their own language. One way: out."""

from typing import Final

from daemon.commands.terminal.command_line import CommandGroup

_GROUP: Final = CommandGroup(
    "bridge",
    "TO",
    {
        "openigtlink": "to 3D Slicer, PLUS and others that read OpenIGTLink",
        "ros2": "to ROS 2 with rmw_zenoh, without any ROS here",
        "foxglove": "to Foxglove and Lichtblick, live",
    },
)
add_arguments: Final = _GROUP.add_arguments
run: Final = _GROUP.run
