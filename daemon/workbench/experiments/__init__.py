"""One experiment, in virtual or real time: from its file to its result."""
