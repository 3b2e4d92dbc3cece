"""What a bag's metadata say is what any YAML reader finds in them."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from arl_fixtures.recording.block_yaml import block_yaml

ODD = (
    "",
    "no",
    "NULL",
    "~",
    "1e5",
    "0x1F",
    "12:30",
    ".inf",
    "- a",
    "a: b",
    "a #b",
    "5fc0",
    "\x85",
    "\u2028",
    "{{7}}",
)
TEXT = st.text() | st.sampled_from(ODD)
SCALARS = TEXT | st.integers() | st.booleans()
TREES = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner), max_leaves=12)


@settings(deadline=None)
@given(TREES)
@example({"duts": '["SN-1", "é\\n🜛"]', "none": [], "nothing": {}, "deep": [[["a"], {"b": [True, -1]}]]})
def test_every_tree_is_read_back_as_it_was(tree):
    for version in ("1.1", "1.2"):
        assert YAML(typ="safe", pure=True).load(f"%YAML {version}\n---\n{block_yaml(tree)}") == tree


def test_it_is_laid_out_as_rosbag2_does_it():
    topic = {"name": "/a", "profiles": [{"depth": 10, "lifespan": {"sec": 1}}], "keep": False, "hash": ""}
    assert block_yaml({"topics": [topic]}) == (
        'topics:\n- name: /a\n  profiles:\n  - depth: 10\n    lifespan:\n      sec: 1\n  keep: false\n  hash: ""\n'
    )


@pytest.mark.parametrize("foreign", [1.5, None, {"a": object()}])
def test_what_is_no_metadata_is_refused(foreign):
    with pytest.raises(TypeError, match="no place"):
        block_yaml(foreign)
