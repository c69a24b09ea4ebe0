"""What stands around the vehicle: streets of our own, meshes and scenes of others."""
