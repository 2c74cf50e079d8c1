"""What a run leaves on disk: the recording, its folder, its result and its report."""
