"""The bench: clock, links, control, settle, sweep, interlock."""
