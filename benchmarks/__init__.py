"""Measurements of the project by itself: proof, speed, baselines."""
