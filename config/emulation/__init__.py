"""What stands in for the hardware when there is none. A real rig ignores this part."""
