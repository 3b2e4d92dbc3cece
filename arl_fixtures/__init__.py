"""Accelerated real-life testing of LiDAR sensors: bench fixtures, twin, metrics, reconciliation."""

import os

__version__ = "0.1.0"

# before numpy comes: no matrix here is worth a second thread of linear algebra, whose waiting costs tens of times the
# work where emulators and recorders share the cores; and with one thread sums are the same to the last digit anywhere
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
