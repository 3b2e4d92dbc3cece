"""The metrics, one a file; each holds `METRIC`. See `arl_fixtures.metrics.registry`."""
