"""Reading meshes of every kind, and saying what is wrong with them."""
