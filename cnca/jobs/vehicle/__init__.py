"""What the commands about a vehicle do: checking it, and laying out its UVs."""
