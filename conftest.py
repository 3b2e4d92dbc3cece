"""The bench fixtures come from the installed plugin `arl_fixtures`; nothing lives here."""
