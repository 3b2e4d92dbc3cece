"""One file per effect; `arl_fixtures.reconcile.library` scans the folder, so a new file is all a new effect needs."""
