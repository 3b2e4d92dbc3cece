"""A session's input files kept beside its journal, so that its report needs nothing else.

`inputs/` holds the bench file with its DUT files, the profile and the limits, each under the SHA-256 that the journal
names it by. What is there already is not written again: sessions with the same files share them.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from arl_fixtures.bench.config import BenchConfig, read_bench
from arl_fixtures.errors import ConfigError
from arl_fixtures.files import write_whole

FOLDER: Final = "inputs"
DIGITS: Final = 16
"""Of the hash in a name; the whole hash is compared when a file is read."""


def keep_bench(config: BenchConfig, out: Path) -> Path:
    """Copy bench file and DUT files into an output folder.

    Returns:
        the folder of the copies.

    Raises:
        ConfigError: a file was changed after it had been read.
        StorageError: they cannot be written.
    """
    folder = _bench_folder(out, config.sha256)
    named = {"bench.yaml": config.files[0]}
    named |= {_unit_name(place): path for place, path in enumerate(config.files[1:], start=1)}
    contents = {name: _read(path) for name, path in named.items()}
    digest = hashlib.sha256(b"".join(contents.values())).hexdigest()
    if digest != config.sha256:
        raise ConfigError("a bench or DUT file was changed while the session began", path=config.files[0])
    for name, content in contents.items():
        _keep(folder / name, content)
    return folder


def keep_file(path: Path, sha256: str, kind: str, out: Path) -> Path:
    """Copy one input file.

    Args:
        path: the file.
        sha256: what it was when it was read.
        kind: ``profile`` or ``limits``.
        out: output folder.

    Raises:
        ConfigError: it was changed after it had been read.
        StorageError: it cannot be written.
    """
    content = _read(path)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ConfigError("was changed while the session began", path=path)
    kept = _file(sha256, kind, out)
    _keep(kept, content)
    return kept


def kept_bench(out: Path, sha256: str) -> BenchConfig | None:
    """The bench that a journal in an output folder names; None where it was not kept, or is not what it was.

    Raises:
        ConfigError: it is there and cannot be read here, e.g. because a driver is not installed.
    """
    folder = _bench_folder(out, sha256)
    if not (folder / "bench.yaml").is_file():
        return None
    units = sorted(folder.glob("dut-*.yaml"))
    config = read_bench(folder / "bench.yaml", units)
    return config if config.sha256 == sha256 else None


def kept_file(sha256: str, kind: str, out: Path) -> Path | None:
    """What `keep_file` kept under a hash; None where it was not kept, or is not what it was."""
    path = _file(sha256, kind, out)
    return path if path.is_file() and hashlib.sha256(_read(path)).hexdigest() == sha256 else None


def _file(sha256: str, kind: str, out: Path) -> Path:
    return out / FOLDER / f"{kind}-{sha256[:DIGITS]}.yaml"


def _bench_folder(out: Path, sha256: str) -> Path:
    return out / FOLDER / f"bench-{sha256[:DIGITS]}"


def _unit_name(place: int) -> str:
    return f"dut-{place:03d}.yaml"


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"cannot read: {error.strerror}", path=path) from None


def _keep(path: Path, content: bytes) -> None:
    if not path.is_file():
        write_whole(path, content)
