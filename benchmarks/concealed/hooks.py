"""Stages of a small sensor model at which effects act, and the helper that turns such a model into a `Sensor`."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.concealed.effect import Effect
from benchmarks.concealed.flash import Expected

Stage = Callable[..., np.ndarray]


class Hooks:
    """Functions per stage; `run` passes a value through them in the order they were added."""

    def __init__(self) -> None:
        self._stages: dict[str, list[Stage]] = defaultdict(list)

    def add(self, stage: str, function: Stage) -> None:
        self._stages[stage].append(function)

    def run(self, stage: str, rows: Any, value: np.ndarray, *more: np.ndarray) -> np.ndarray:
        for function in self._stages[stage]:
            value = function(rows, value, *more)
        return value


def answering(model: Callable[[Any, Hooks], Expected], rows: Any) -> Callable[[list[tuple[Effect, float]]], Expected]:
    """`Sensor.answer` of a model of rows and hooks."""

    def answer(effects: list[tuple[Effect, float]]) -> Expected:
        hooks = Hooks()
        for effect, amount in effects:
            effect.apply(hooks, amount)
        return model(rows, hooks)

    return answer
