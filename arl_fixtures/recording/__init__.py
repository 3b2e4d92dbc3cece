"""Bags: writing, reading, recovering."""
