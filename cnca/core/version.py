"""The version of the package, also read by its build."""

VERSION = "0.1.0"
