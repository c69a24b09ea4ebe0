"""Labelled pictures: their layout, and where they come from."""
