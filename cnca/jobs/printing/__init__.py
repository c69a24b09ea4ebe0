"""A camouflage on paper: what inks can show, and sheets of true size."""
