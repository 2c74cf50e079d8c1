"""An emulated NDI Aurora."""
