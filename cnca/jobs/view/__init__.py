"""A live view of a scene in the browser: what is asked for, the scene that it is, its picture."""
