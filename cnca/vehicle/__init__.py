"""The vehicle: its mesh, its UV layout, and the bodies that ship."""
