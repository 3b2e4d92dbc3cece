"""Upright boards before a round wall, seen by a pinhole camera on a stage: a renderer for tests alone."""

import numpy as np

F_PX, COLUMNS, ROWS = 40.0, 30, 3
BOARDS = ((-34.0, 9.0, 1.4, 0.7), (-12.0, 5.0, 1.1, 0.3), (6.0, 8.0, 1.3, 0.5), (27.0, 6.0, 1.0, 0.8))
"""Bearing of the middle and half width, degrees; distance, metres; reflectance."""


def seen(u, v, stage, *, roll=0.0, boards=BOARDS):
    """Light and range of pixels of a pinhole camera, 101 rays across each, on upright boards before a round wall."""
    light, moment = np.zeros(u.size), np.zeros(u.size)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    for part in (np.arange(101) - 50.0) / 101.0:
        x, y = (u + part - (COLUMNS - 1) / 2) / F_PX, ((ROWS - 1) / 2 - v) / F_PX
        x, y = c * x + s * y, c * y - s * x
        bearing, rise = np.degrees(np.arctan(x)) + stage, np.cos(np.arctan2(y, np.hypot(1.0, x)))
        level, paint = np.full(u.size, 1.8), np.full(u.size, 0.35)
        for middle, half, far, white in boards:
            on = np.abs(bearing - middle) < half
            level, paint = np.where(on, far, level), np.where(on, white, paint)
        one = paint * rise**3 / level**2
        light, moment = light + one / 101.0, moment + one * level / rise / 101.0
    return light, moment / light
