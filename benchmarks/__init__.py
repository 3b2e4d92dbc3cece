"""Measurements of the project by itself: proof, speed, baselines."""

import arl_fixtures  # noqa: F401 - before numpy: it says in how many threads that calculates
