"""Which effect is simulated how, and what that costs: data in, data out."""
