"""The operator's page: a process of its own that is an ordinary client, and serves browsers."""
