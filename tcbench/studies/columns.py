"""What the columns of the tables are."""

from __future__ import annotations

BOOKKEEPING = {  # columns that say where a row comes from
    "plugin", "source_hash", "scenario_hash", "tcbench_version", "wall_time_s", "cell_time_s", "timed", "key",
    "failure", "study", "exception_type", "traceback",
}  # fmt: skip
