"""How a run is written: channels, the recorder's stream, MCAP."""
