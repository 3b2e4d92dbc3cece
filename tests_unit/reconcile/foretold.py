"""How much of what a simulation lacks a prediction tells, on rows that it has never seen."""

import numpy as np


def share_told(off: np.ndarray, left: np.ndarray) -> float:
    """1 − Σ left² / Σ off², of what the simulation is off by and what is left of it."""
    return 1.0 - float(left @ left) / float(off @ off)
