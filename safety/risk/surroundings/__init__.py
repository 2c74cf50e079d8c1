"""What a body may touch: solids by their meshes, distances to them, and the space that is free."""
