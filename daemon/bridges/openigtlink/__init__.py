"""OpenIGTLink, for 3D Slicer, PLUS and others that read it: codec, what is told, and a server."""
