"""What an evaluation shows, from pictures of a scene to tables with intervals."""
