"""The pytest plugin: options, fixtures, one test per temperature step, outcome and reports."""
