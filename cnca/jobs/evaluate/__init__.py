"""Evaluations of textures: rendered scenes, CARLA frames, photographs."""
