"""Commands for the shell that the others are typed in: completion and man pages."""
