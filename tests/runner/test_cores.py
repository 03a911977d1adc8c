"""A container's quota counts: eight workers on a quota of two cores would throttle each other."""

import os

import pytest

from tcbench.runner import cores


@pytest.fixture
def sixteen(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(16)), raising=False)


def system(root, groups, files):
    """A root folder with /proc/self/cgroup and files under /sys/fs/cgroup."""
    (root / "proc" / "self").mkdir(parents=True)
    (root / "proc" / "self" / "cgroup").write_text(groups)
    for name, text in files.items():
        path = root / "sys" / "fs" / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    return root


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("0::/\n", {}, 16),
        ("0::/\n", {"cpu.max": "max 100000"}, 16),
        ("0::/\n", {"cpu.max": "200000 100000"}, 2),
        ("0::/\n", {"cpu.max": "150000 100000"}, 2),
        ("0::/\n", {"cpu.max": "10000 100000"}, 1),
        ("0::/jobs/a\n", {"jobs/a/cpu.max": "max 100000", "jobs/cpu.max": "400000 100000"}, 4),  # the group around it
        ("0::/host/path\n", {"cpu.max": "300000 100000"}, 3),  # the host's name of a container
        ("4:memory:/\n3:cpu,cpuacct:/a\n", {"cpu,cpuacct/a/cpu.cfs_quota_us": "250000",
                                            "cpu,cpuacct/a/cpu.cfs_period_us": "50000"}, 5),
        ("3:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, 16),
        ("0::/\n", {"cpu.max": "rubbish"}, 16),
        ("rubbish", {}, 16),
    ],
)  # fmt: skip
def test_the_quota_of_a_group_and_of_those_around_it_counts(sixteen, tmp_path, groups, files, expected):
    assert cores.usable_cores(system(tmp_path, groups, files)) == expected


def test_without_groups_the_affinity_counts(sixteen, tmp_path):
    assert cores.usable_cores(tmp_path) == 16
    assert 1 <= cores.usable_cores() <= 16
