"""One attack from start to report, and sweeps of them."""
