"""Training of all networks that ship: one loop, one file for each network."""
