"""The bodies that ship with the package, made by formulas."""
