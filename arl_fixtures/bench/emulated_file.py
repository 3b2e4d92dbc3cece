"""A bench file that points at running emulators, made from the bench file they were started with."""

from __future__ import annotations

import io
from collections.abc import Mapping

from ruamel.yaml import YAML

from arl_fixtures.bench.config import bench_path
from arl_fixtures.yaml_model import load_yaml


def bench_file_for(bench_file: str, urls: Mapping[str, str], *, duts: bool = True) -> str:
    """Text of the bench file with real time, the given URLs, and DUTs that send on the network.

    Args:
        bench_file: name or path, as for `load_bench`.
        urls: URL of each emulated control line by role; the others stay as they are.
        duts: whether the DUTs are emulated.

    Raises:
        ConfigError: the bench file cannot be read.
    """
    path = bench_path(bench_file)
    tree = load_yaml(path)
    tree["clock"] = "real"
    for kind, url in urls.items():
        tree[kind]["url"] = url
        tree[kind].pop("emulator", None)
    if duts:
        tree["duts"]["url"] = "udp://127.0.0.1"
        tree["duts"].pop("emulator", None)
    tree["duts"]["units"] = [str((path.parent / unit).resolve()) for unit in tree["duts"]["units"]]
    tree.pop("emulation", None)
    buffer = io.StringIO()
    YAML(typ="rt", pure=True).dump(tree, buffer)
    return buffer.getvalue()
