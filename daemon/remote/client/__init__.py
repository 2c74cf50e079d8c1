"""The client's side: find a daemon, command it, and listen to it."""
