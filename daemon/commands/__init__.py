"""The commands of `tentacled`, one module each, imported when used."""
