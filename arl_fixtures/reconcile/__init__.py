"""Find, name, model and show the physics a simulation left out."""
