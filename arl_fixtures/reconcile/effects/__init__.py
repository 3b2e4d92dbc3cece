"""The vocabulary of missing physics, one file per effect."""
