"""How moist the air before a window was: a dew point as it was logged, or from a relative humidity and its air.

Saturation by the Magnus formula (WMO-No. 8, annex 4.B), over water.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from arl_fixtures.reconcile.effect import Option
from arl_fixtures.reconcile.effects_common import FloatArray, per_table, rounded
from arl_fixtures.reconcile.effects_history import history
from arl_fixtures.reconcile.view import View

_AT_ZERO_HPA, _RISE, _BASE_K = 6.112, 17.62, 243.12
_AIR = ("ambient", "air", "chamber", "plate", "set")
"""Beginnings of names of temperatures that may be those of the air whose humidity was logged, nearest first."""
_LARGEST_SHARE = 1.5
"""Humidity above which a column states percent."""


def vapour_hpa(temperature_c: FloatArray | float) -> FloatArray:
    """Saturation vapour pressure over water, Magnus formula."""
    warm = np.maximum(temperature_c, -100.0)
    return np.asarray(_AT_ZERO_HPA * np.exp(_RISE * warm / (_BASE_K + warm)))


def moistures(view: View) -> Iterable[dict[str, Option]]:
    """What a table tells of the air's moisture, as options of a variant: a dew point, else a relative humidity."""
    logged = [n for n in view.covariates("_c") if "dew_point" in n or "frost_point" in n]
    if logged:
        yield {"dew": logged[0]}
        return
    for humidity in [n for n in view.covariates() if "humidity" in n][:1]:
        own = humidity.partition("humidity")[0]
        begins = [own] if own.strip("_") else []
        of_air = [n for word in [*begins, *_AIR] for n in view.covariates("_temperature_c") if n.startswith(word)][:1]
        for air in of_air:
            full = 100.0 if view.span(humidity)[1] > _LARGEST_SHARE else 1.0
            yield {"dew": air, "humidity": humidity, "full": rounded(full)}


def dew_points(view: View, options: Mapping[str, Option]) -> FloatArray | None:
    """Dew point in °C over each history, as the `options` of `moistures` tell it; None where nothing tells."""
    air = history(view, str(options["dew"])) if "dew" in options else None
    if air is None or "humidity" not in options:
        return None if air is None else air.values
    humid, full = history(view, str(options["humidity"])), float(str(options["full"]))
    if humid is None:
        return None

    def convert() -> FloatArray:
        pressure = np.clip(humid.values / full, 1e-3, 1.0) * vapour_hpa(air.values)
        level = np.log(pressure / _AT_ZERO_HPA)
        return np.asarray(_BASE_K * level / (_RISE - level))

    return per_table(view, ("dew point", options["dew"], options["humidity"], full), convert)
