"""CANopen's services as bytes and values, one file each. Used by master and emulated node alike."""
