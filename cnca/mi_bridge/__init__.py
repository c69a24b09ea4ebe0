"""Mitsuba 3: the only package that imports mitsuba or drjit."""
