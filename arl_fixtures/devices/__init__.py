"""Drivers: what the bench asks of a device, spoken through a port."""
