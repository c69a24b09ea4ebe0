"""The scene as data: vehicle, paint, cameras, sun, sky, fog.  Neither torch nor Mitsuba here."""
