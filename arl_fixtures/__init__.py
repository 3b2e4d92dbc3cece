"""Accelerated real-life testing of LiDAR sensors: bench fixtures, twin, metrics, reconciliation."""

__version__ = "0.1.0"
