"""What `tentacled probe` shows: the devices as their drivers see them, nothing energised."""
