"""YAML for a bag's metadata: mappings, lists, text, whole numbers and truth values, in block style.

A general emitter analyses each scalar anew and takes a quarter of a small cycle's time over the topics of two DUTs.
What is written here any YAML 1.1 or 1.2 reader takes for the same tree.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Final

_PLAIN: Final = re.compile(r"[A-Za-z/][A-Za-z0-9_/+.-]*")
_WORDS: Final = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})
"""Plain words that some YAML reader takes for something else than text, in any case of letters."""
_HIDDEN: Final = re.compile("[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")
"""What JSON leaves as it is in a text and YAML does not allow or breaks lines at."""


def block_yaml(tree: object) -> str:
    """A tree as a YAML document.

    Args:
        tree: mappings with text as keys, lists, `str`, `int`, `bool`, as deep as need be.

    Raises:
        TypeError: something else is in it.
    """
    return "".join(f"{line}\n" for line in _lines(tree))


def _lines(tree: object) -> Iterator[str]:
    if isinstance(tree, Mapping) and tree:
        for name, value in tree.items():
            key = f"{_scalar(name)}:"
            if not value or not isinstance(value, (Mapping, list)):
                yield f"{key} {_scalar(value)}"
            else:
                yield key
                indent = "  " if isinstance(value, Mapping) else ""
                yield from (indent + line for line in _lines(value))
    elif isinstance(tree, list) and tree:
        for item in tree:
            mark = "- "
            for line in _lines(item):
                yield mark + line
                mark = "  "
    else:
        yield _scalar(tree)


def _scalar(value: object) -> str:
    if isinstance(value, str):
        if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
            return value
        return _HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", json.dumps(value, ensure_ascii=False))
    if isinstance(value, (int, list, Mapping)) and (isinstance(value, int) or not value):
        return json.dumps(value)
    raise TypeError(f"{value!r} has no place in a bag's metadata")
