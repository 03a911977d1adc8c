"""A desk for attacks on rows that are used again."""

import os
import sys

import pytest
from desks import forget

from tcbench.inputs import undone


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with two folders of plugins, p and q, and one of other things."""
    as_before = undone.environment()  # variables that plugins of earlier tests have set here
    undone._CHANGED.clear()
    for name in os.environ.keys() - as_before.keys():
        del os.environ[name]
    os.environ.update(as_before)
    for name in ("p", "q", "lib"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    forget(tmp_path)
