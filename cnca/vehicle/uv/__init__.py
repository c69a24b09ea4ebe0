"""UV layouts: unfolding, unwrapping, checking, and painting texels anew."""
