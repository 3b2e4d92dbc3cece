"""What docs/security.md promises of this package's own code and of names that become paths."""

import ast
import os
import socket
from pathlib import Path

import pytest
from pydantic import ValidationError

import arl_fixtures
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.profile import Profile
from arl_fixtures.errors import ArlError, ConfigError
from arl_fixtures.lab.framing import Link, listen
from arl_fixtures.twin.settings import DutSettings
from arl_fixtures.yaml_model import load_yaml

SOURCES = sorted(Path(arl_fixtures.__file__).parent.rglob("*.py"))
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "marshal", "shelve", "yaml"}
FORBIDDEN_CALLS = {"eval", "exec", "os.system", "os.popen"}


def calls(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), {keyword.arg: keyword.value for keyword in node.keywords}


def test_no_source_unpickles_evaluates_or_starts_a_shell():
    found = []
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            found += [f"{path.name}: imports {name}" for name in names if name.partition(".")[0] in FORBIDDEN_MODULES]
        for name, keywords in calls(tree):
            if name in FORBIDDEN_CALLS:
                found.append(f"{path.name}: {name}")
            shell = keywords.get("shell")
            if shell is not None and not (isinstance(shell, ast.Constant) and shell.value is False):
                found.append(f"{path.name}: {name}(shell=…)")
            if name.endswith("np.load") and ast.unparse(keywords.get("allow_pickle", ast.Constant(None))) != "False":
                found.append(f"{path.name}: np.load without allow_pickle=False")
    assert SOURCES
    assert found == []


@pytest.mark.parametrize("name", ["..", ".hidden", "a/b", "../a", "a\\b", "", "a\nb", "-rf"])
@pytest.mark.parametrize(("model", "key"), [(BenchConfig, "name"), (BenchConfig, "campaign"), (Profile, "name")])
def test_names_that_become_paths_stay_in_their_folder(model, key, name):
    with pytest.raises(ValidationError) as error:
        model.model_validate({key: name})
    assert any(detail["loc"] == (key,) and detail["type"] != "missing" for detail in error.value.errors())


@pytest.mark.parametrize("serial", ["../../x", "..", "a/b", "a\\b", ".x"])
def test_serial_numbers_that_name_files_stay_in_their_folder(serial):
    with pytest.raises(ValidationError, match="has no slash"):
        DutSettings(serial=serial)


@pytest.mark.parametrize(
    "text",
    ["a: !!python/object/apply:os.system ['true']", "a: !!python/name:os.system", "a: 1\na: 2"],
)
def test_yaml_constructs_nothing_and_keeps_no_duplicate(tmp_path, text):
    path = tmp_path / "f.yaml"
    path.write_text(text)
    try:
        tree = load_yaml(path)
    except ConfigError:
        return
    # an unknown tag is kept as plain text or list, never called
    assert not callable(tree["a"])
    assert type(tree["a"]).__module__.startswith("ruamel.yaml")


def test_sockets_are_private_and_never_stolen(tmp_path):
    path = tmp_path / "s"
    listener = listen(path)
    assert path.stat().st_mode & 0o777 == 0o600
    with pytest.raises(ArlError, match="somebody listens there already"):
        listen(path)
    listener.close()
    # what a dead process left is replaced
    again = listen(path)
    Link.connect(path).close()
    again.close()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ArlError, match="cannot listen"):
        listen(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_peers_are_known_by_the_kernels_word(tmp_path):
    from arl_fixtures.lab.framing import Peer

    ours, theirs = socket.socketpair(socket.AF_UNIX)
    with theirs:
        peer = Peer(ours)
        assert peer.pid == os.getpid()
        peer.close()
