"""The user's cache: private, within its limit, cleared by a command; no process minds what another one removes."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from tcbench import TcbenchError, cache
from tcbench.cli import main

NAMES = [f"{i:064x}.o" for i in range(6)]
posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="other systems have other permissions")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.FOLDER, str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_what_was_written_is_read_until_it_is_damaged(place):
    assert cache.read("code", NAMES[0]) is None
    assert cache.kept("code", NAMES[0], lambda: b"content") == b"content"
    assert cache.kept("code", NAMES[0], lambda: b"other") == b"content"
    path = place / "code" / NAMES[0]
    path.write_bytes(path.read_bytes()[:-1] + b"T")
    assert cache.read("code", NAMES[0]) is None
    assert cache.kept("code", NAMES[0], lambda: b"other") == b"other" == cache.read("code", NAMES[0])


@posix
def test_another_file_is_not_taken_for_this_one(place):
    one, two = (cache.folder("code") / name for name in NAMES[:2])
    for path in (one, two):
        cache.write("code", path.name, path.name.encode())
    one.write_bytes(two.read_bytes())
    assert cache.read("code", one.name) is None and cache.read("code", two.name) == two.name.encode()


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077, 0o777])
def test_it_is_private_whatever_the_umask(place, umask):
    before = os.umask(umask)
    try:
        cache.write("code", NAMES[0], b"content")
    finally:
        os.umask(before)
    modes = [path.stat().st_mode & 0o777 for path in (place, place / "code", place / "code" / NAMES[0])]
    assert modes == [0o700, 0o700, 0o600] and cache.read("code", NAMES[0]) == b"content"


@posix
def test_what_others_may_write_is_not_trusted(place):
    cache.write("code", NAMES[0], b"content")
    (place / "code" / NAMES[0]).chmod(0o660)
    assert cache.read("code", NAMES[0]) is None  # and is made again
    for folder in (place, place / "code"):
        for mode in (0o770, 0o707):
            folder.chmod(mode)
            cache._TRUSTED.clear()
            with pytest.raises(TcbenchError, match=r"Other users may write .* chmod go-w .*TCBENCH_CACHE_DIR"):
                cache.read("code", NAMES[0])
            folder.chmod(0o700)


@posix
def test_a_folder_of_another_user_is_not_trusted(place, monkeypatch):
    cache.write("code", NAMES[0], b"content")
    cache._TRUSTED.clear()
    monkeypatch.setattr(os, "getuid", lambda: place.stat().st_uid + 1)
    with pytest.raises(TcbenchError, match="belongs to another user and is not trusted: set TCBENCH_CACHE_DIR"):
        cache.read("code", NAMES[0])


def test_beyond_the_limit_goes_what_was_not_used_for_longest(place, monkeypatch):
    for age, name in enumerate(NAMES):
        cache.write("code", name, bytes(200_000))
        when = time.time() - 86400 * (10 - age)
        os.utime(place / "code" / name, (when, when))
    assert cache.read("code", NAMES[0]) is not None  # used just now
    cache.prune()
    assert cache.usage().files == 6
    monkeypatch.setenv(cache.LIMIT, "0.8")
    cache.prune()
    left = sorted(path.name for path in (place / "code").iterdir())
    assert left == [NAMES[0], *NAMES[4:]] and cache.usage().bytes <= 0.8 * 2**20
    assert cache.kept("code", NAMES[1], lambda: b"again") == b"again"  # who wants what is gone makes it again


@pytest.mark.parametrize("asked", ["much", "-1", "nan", "inf"])
def test_a_limit_that_is_no_number_is_one_sentence(monkeypatch, asked):
    monkeypatch.setenv(cache.LIMIT, asked)
    with pytest.raises(TcbenchError, match=f"TCBENCH_CACHE_LIMIT is '{asked}'"):
        cache.limit()


def test_only_its_own_files_are_counted_and_removed(place):
    kept = [place / "thesis.o", place / "code" / "notes.txt"]
    cache.write("code", NAMES[0], b"content")
    cache.write("references", "0" * 32 + ".json", b"content")
    when = time.time() - 2 * cache.USED_S
    half_written = place / "code" / f".{'0' * 64}.{'b' * 12}.o"
    half_written.write_bytes(b"half")
    os.utime(half_written, (when, when))
    for path in kept:
        path.write_text("mine")
    cache.prune()  # what a killed process left
    assert not half_written.exists() and cache.usage().files == 2
    before = cache.clear()
    assert before.files == 2 and cache.usage().files == 0 and cache.usage().bytes == 0
    assert sorted(path for path in place.rglob("*") if path.is_file()) == sorted(kept)
    cache.write("code", NAMES[0], b"content")


def read_only(*_, **__):
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def test_the_command_says_where_how_large_and_clears(place, monkeypatch):
    cache.write("code", NAMES[0], bytes(3 * 2**20))
    said = CliRunner().invoke(main, ["cache"])
    assert said.exit_code == 0 and str(place) in said.output.replace("\n", "")
    assert "1 file" in said.output and "3.0 of 512 MiB" in said.output and "tcbench cache clear" in said.output
    cleared = CliRunner().invoke(main, ["cache", "clear"])
    assert cleared.exit_code == 0 and "Removed 1 file" in cleared.output and cache.usage().files == 0
    cache.write("code", NAMES[0], b"content")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", read_only)
        refused = CliRunner().invoke(main, ["cache", "clear"])  # said that it had removed them
    told = " ".join(refused.output.split())
    assert refused.exit_code == 2 and "1 of 1 files" in told and "Read-only file system" in told
    wrong = CliRunner().invoke(main, ["cache", "wipe"])
    assert wrong.exit_code == 2 and "wipe" in wrong.output


USE = """import sys
from tcbench import cache
for round in range(200):
    name = f"{round % 40:064x}.o"
    if sys.argv[1] == "use":
        assert cache.kept("code", name, lambda: name.encode() * 100) == name.encode() * 100
    else:
        getattr(cache, sys.argv[1])()
"""


def test_nobody_minds_what_another_process_removes(place):
    env = os.environ | {cache.LIMIT: "0.05"}
    running = [subprocess.Popen([sys.executable, "-c", USE, what], env=env, stderr=subprocess.PIPE, text=True)
               for what in ("use", "use", "prune", "clear")]  # fmt: skip
    assert [(process.communicate()[1], process.returncode) for process in running] == [("", 0)] * 4
