"""An arm of rods, disks and tendons."""
