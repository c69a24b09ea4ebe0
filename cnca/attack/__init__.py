"""One attack as a run: its folder, checkpoints, forecast and processes."""
