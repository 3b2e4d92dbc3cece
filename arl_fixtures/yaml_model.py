"""YAML file to validated model, with `file:line:column` in every complaint.

YAML 1.2 through ruamel.yaml's round-trip loader: it keeps the place of every key, refuses duplicate keys,
reads `1e-3` as a number and never constructs Python objects. Validation is pydantic's; models are strict,
frozen and refuse unknown keys by deriving from `FileModel`.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from arl_fixtures.errors import ConfigError


class FileModel(BaseModel):
    """Base of everything read from a user's YAML file: frozen, no unknown keys, no silent conversion."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)


class FiniteModel(FileModel):
    """A file model in which no number may be infinite or NaN."""

    model_config = ConfigDict(allow_inf_nan=False)


ModelT = TypeVar("ModelT", bound=BaseModel)


def load_yaml(path: Path) -> Any:  # noqa: ANN401 - a YAML document is anything until it is validated
    """Parse one YAML document.

    Returns:
        ruamel's round-trip tree (dicts and lists with marks).

    Raises:
        ConfigError: the file cannot be read or is not one YAML document.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot read: {error.strerror}", path=path) from None
    except UnicodeDecodeError:
        raise ConfigError("is not UTF-8 text", path=path) from None
    try:
        return YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
        problem = " ".join(str(error.problem or error.context or "not YAML").split())
        raise ConfigError(problem, path=path, line=line, column=column) from None
    except (YAMLError, ValueError) as error:  # ValueError: what looks like a date and is none
        raise ConfigError(" ".join(str(error).split()), path=path) from None


def named_file(name_or_path: str, folder: Path, kind: str) -> Path:
    """A YAML file by its path, or by the name of one that comes with the package.

    Args:
        name_or_path: what a user gave.
        folder: of those that come with the package.
        kind: what they are, for the message.

    Raises:
        ConfigError: none has this name.
    """
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml"}:
        return path
    built_in = folder / f"{name_or_path}.yaml"
    if not built_in.is_file():
        known = ", ".join(sorted(each.stem for each in folder.glob("*.yaml")))
        raise ConfigError(f"no {kind} '{name_or_path}'; known are {known}, or give a .yaml file")
    return built_in


def load_model(path: Path, model: type[ModelT]) -> ModelT:
    """Read `path` as a `model`.

    Raises:
        ConfigError: every fault of the file, one a line, each with file, line and column.
    """
    tree = load_yaml(path)
    if tree is None:
        raise ConfigError(f"is empty; expected a {model.__name__}", path=path)
    return validate_tree(path, tree, model)


def fault_at(path: Path, place: list[str | int], message: str) -> ConfigError:
    """A complaint about the value at `place` of a file that is otherwise well-formed, with its line and column."""
    line, column, _ = _mark(load_yaml(path), place, at_key=False)
    return ConfigError(f"{'.'.join(map(str, place))}: {message}", path=path, line=line, column=column)


def validate_tree(path: Path, tree: Any, model: type[ModelT]) -> ModelT:  # noqa: ANN401 - not validated yet
    """Check a document, or a block of one that kept its marks, against a `model`.

    Raises:
        ConfigError: every fault, one a line, each with file, line and column.
    """
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        faults = [_fault(path, tree, detail, model) for detail in error.errors(include_url=False)]
        faults.sort(key=lambda fault: (fault.line, fault.column))
        if len(faults) == 1:
            raise faults[0] from None
        first = faults[0]
        combined = ConfigError("\n".join(str(fault) for fault in faults))
        combined.path, combined.line, combined.column = first.path, first.line, first.column
        raise combined from None


def _fault(path: Path, tree: Any, detail: ErrorDetails, model: type[BaseModel]) -> ConfigError:  # noqa: ANN401
    place = [part for part in detail["loc"] if not (isinstance(part, str) and part.startswith("function-"))]
    line, column, depth = _mark(tree, place, at_key=detail["type"] in {"extra_forbidden", "missing"})
    key = ".".join(str(part) for part in place) or model.__name__
    if detail["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(place[-1]), _siblings(model, place), n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        return ConfigError(f"unknown key '{key}'{hint}", path=path, line=line, column=column)
    if detail["type"] == "missing":
        return ConfigError(f"key '{key}' is missing", path=path, line=line, column=column)
    said = detail["msg"].removeprefix("Value error, ")
    got = detail.get("input")
    shown = f" (got {got!r})" if isinstance(got, (str, int, float, bool)) and depth == len(place) else ""
    return ConfigError(f"{key}: {said[0].lower() + said[1:]}{shown}", path=path, line=line, column=column)


def _siblings(model: type[BaseModel], place: list[str | int]) -> list[str]:
    """Names of keys allowed where an unknown one stood, as far as plain nesting tells."""
    current: Any = model
    for part in place[:-1]:
        field = getattr(current, "model_fields", {}).get(part) if isinstance(part, str) else None
        if field is None:
            return list(getattr(current, "model_fields", {}))
        current = field.annotation
    return list(getattr(current, "model_fields", {}))


def _mark(tree: Any, place: list[str | int], *, at_key: bool) -> tuple[int, int, int]:  # noqa: ANN401
    """Line and column (1-based) of the deepest part of `place` that the file has, and how deep that is."""
    node, depth = tree, 0
    line, column = (node.lc.line, node.lc.col) if hasattr(node, "lc") else (0, 0)
    for part in place:
        if not hasattr(node, "lc"):
            break
        try:
            last = depth + 1 == len(place)
            if isinstance(node, CommentedMap):
                if part not in node:
                    # discriminated unions put a tag into the location that the file does not have
                    depth += 1
                    continue
                line, column = node.lc.key(part) if at_key or not last else node.lc.value(part)
            elif isinstance(part, int) and part < len(node):
                line, column = node.lc.item(part)
            else:
                break
            node, depth = node[part], depth + 1
        except (KeyError, IndexError, TypeError):
            break
    return line + 1, column + 1, depth
