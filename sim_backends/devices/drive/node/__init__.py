"""The emulated drive as a CANopen node (CiA 301): objects, SDO, PDO, SYNC, heartbeat, EMCY."""
