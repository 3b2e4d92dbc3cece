"""A value with its unit and standard uncertainty."""
