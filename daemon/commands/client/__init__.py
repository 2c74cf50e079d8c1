"""Commands that ask a running daemon for something."""
