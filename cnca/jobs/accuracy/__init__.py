"""What accuracy costs in time: references, ladders and the prices of models."""
