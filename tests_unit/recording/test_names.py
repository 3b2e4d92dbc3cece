from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import StorageError
from arl_fixtures.recording.names import bag_name, inside, safe_file_name, topic_tokens

ANY_TEXT = st.text(st.characters(codec=None), max_size=120)


@given(ANY_TEXT)
def test_any_text_becomes_one_component_inside_its_folder(text: str) -> None:
    name = safe_file_name(text)
    assert re.fullmatch(r"[A-Za-z0-9+][A-Za-z0-9._+-]{0,86}", name)
    assert inside(Path("/out"), name).parent == Path("/out")


@given(ANY_TEXT, ANY_TEXT)
def test_two_texts_do_not_share_a_file_name(one: str, other: str) -> None:
    assert (safe_file_name(one) == safe_file_name(other)) == (one == other)


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../b"])
def test_a_name_that_climbs_out_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="outside the output folder"):
        inside(tmp_path, name)


@given(st.lists(ANY_TEXT, max_size=5, unique=True))
def test_topic_tokens_are_ros_names_and_differ(serials: list[str]) -> None:
    tokens = topic_tokens(serials)
    assert list(tokens) == serials
    assert len(set(tokens.values())) == len(serials)
    assert all(re.fullmatch(r"[a-z][A-Za-z0-9_]*", token) and "__" not in token for token in tokens.values())


def test_two_duts_of_one_serial_are_refused() -> None:
    with pytest.raises(StorageError, match="same serial number"):
        topic_tokens(["A", "A"])


def test_attempts_have_their_own_folders() -> None:
    assert bag_name("c0003-07-up+25C", 1) == "c0003-07-up+25C"
    assert bag_name("c0003-07-up+25C", 2) == "c0003-07-up+25C-attempt2"
