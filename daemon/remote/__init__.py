"""How programs outside talk to the daemon: keys, messages, access, server and client."""
