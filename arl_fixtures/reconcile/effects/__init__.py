"""One file per effect; `arl_fixtures.reconcile.catalogue` scans the folder, so a new effect needs one new file."""
