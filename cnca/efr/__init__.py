"""The environment feature renderer (EFR): an optional residual corrector of rendered images."""
