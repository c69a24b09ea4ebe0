"""glTF 2.0: what exporters make of it, put into the plain form that trimesh reads rightly."""
