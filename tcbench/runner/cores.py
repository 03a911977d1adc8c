"""How many cores this process may use: its affinity, and the quota of the container or batch job that it runs in."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path


def usable_cores(root: str | Path = "/") -> int:
    """The cores that this process may keep busy, at least 1.

    A quota (cgroup v2 `cpu.max`; v1 `cpu.cfs_quota_us` and `cpu.cfs_period_us`, of the process's group and of those
    around it) counts rounded up: 1.5 cores keep two workers busy, one of them half the time.

    root : where `proc` and `sys` are, for tests.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([allowed, *(math.ceil(quota) for quota in _quotas(Path(root)))]))


def _quotas(root: Path) -> Iterator[float]:
    """Every quota on this process, in cores."""
    mount = root / "sys" / "fs" / "cgroup"
    for line in _read(root / "proc" / "self" / "cgroup").splitlines():
        _, controllers, path = (line.split(":", 2) + ["", ""])[:3]
        if not controllers:
            top, pair = mount, _pair_v2
        elif "cpu" in controllers.split(","):
            top, pair = next((t for t in (mount / controllers, mount / "cpu") if t.is_dir()), mount / "cpu"), _pair_v1
        else:
            continue
        group = Path(path.lstrip("/"))
        # inside a container the path may be that of the host, which is not there: its own group is then the top
        for folder in [*(top / part for part in (group, *group.parents)), top]:
            quota, period = pair(folder)
            if quota.isdigit() and period.isdigit() and int(quota) > 0 and int(period) > 0:
                yield int(quota) / int(period)


def _pair_v2(folder: Path) -> tuple[str, str]:
    quota, _, period = _read(folder / "cpu.max").strip().partition(" ")
    return quota, period or "100000"  # "max" is none


def _pair_v1(folder: Path) -> tuple[str, str]:
    return _read(folder / "cpu.cfs_quota_us").strip(), _read(folder / "cpu.cfs_period_us").strip()  # -1 is none


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError):
        return ""
