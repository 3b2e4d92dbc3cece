"""All effects there are: every module of `effects/`, and plug-ins under the entry-point group `arl.effects`.

A plug-in's entry point names an `Effect` subclass, an instance, or a module that holds some.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType

import arl_fixtures.reconcile.effects as effects_folder
from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.effect import Effect

PLUGIN_GROUP = "arl.effects"


def _effects_in(module: ModuleType) -> list[Effect]:
    return [
        thing() for _, thing in sorted(vars(module).items())
        if inspect.isclass(thing) and issubclass(thing, Effect) and not inspect.isabstract(thing)
        and thing.__module__ == module.__name__
    ]  # fmt: skip


def built_in() -> list[Effect]:
    """Effects of the package's own folder, by id."""
    found: list[Effect] = []
    for info in sorted(pkgutil.iter_modules(effects_folder.__path__), key=lambda item: item.name):
        found += _effects_in(importlib.import_module(f"{effects_folder.__name__}.{info.name}"))
    return sorted(found, key=lambda effect: effect.id)


def plug_ins() -> list[Effect]:
    """Effects that other installed packages bring.

    Raises:
        DataError: an entry point cannot be loaded or is no effect.
    """
    found: list[Effect] = []
    for point in sorted(entry_points(group=PLUGIN_GROUP), key=lambda item: item.name):
        try:
            thing = point.load()
        except Exception as error:
            raise DataError(f"plug-in effect '{point.name}' ({point.value}) cannot be loaded: {error}") from error
        if inspect.ismodule(thing):
            found += _effects_in(thing)
        elif inspect.isclass(thing) and issubclass(thing, Effect):
            found.append(thing())
        elif isinstance(thing, Effect):
            found.append(thing)
        else:
            raise DataError(f"plug-in effect '{point.name}' ({point.value}) is no Effect")
    return found


@cache
def library() -> dict[str, Effect]:
    """Id to effect.

    Raises:
        DataError: two effects claim one id.
    """
    entries: dict[str, Effect] = {}
    for effect in [*built_in(), *plug_ins()]:
        if effect.id in entries:
            raise DataError(f"effect id '{effect.id}' is claimed by {type(entries[effect.id])} and {type(effect)}")
        entries[effect.id] = effect
    return entries
