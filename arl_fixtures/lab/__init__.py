"""The virtual lab: emulated hardware in a process of its own, which outlives whoever drives it."""
