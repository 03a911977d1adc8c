"""A desk for attacks on rows that are used again."""

import sys

import pytest
from desks import forget


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with two folders of plugins, p and q, and one of other things."""
    for name in ("p", "q", "lib"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    forget(tmp_path)
