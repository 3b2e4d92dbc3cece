"""The append-only journal, the only truth about a session."""
