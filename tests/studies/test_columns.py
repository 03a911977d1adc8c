"""One registry says what a column is; whoever shows or compares columns asks it."""

import pytest

from tcbench.commands import terminal
from tcbench.studies.columns import COLUMNS, column, shown_columns


def test_a_column_that_nobody_described_is_written_as_it_is_called():
    unknown = column("hot_spots")
    assert (unknown.label, unknown.short, unknown.worse, unknown.shown) == ("hot spots", "hot_spots", "", True)


def test_a_described_column_keeps_what_its_pattern_would_say_of_its_direction():
    """A name before a pattern must not lose the direction by saying only what it is called."""
    patterns = [c for c in COLUMNS if "*" in c.name]
    from fnmatch import fnmatchcase

    for known in COLUMNS:
        for pattern in patterns:
            if known.shown and "*" not in known.name and fnmatchcase(known.name, pattern.name):
                assert known.worse == pattern.worse and known.timing == pattern.timing, known.name


def test_names_are_told_once():
    names = [c.name for c in COLUMNS]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name, worse", [("entropy_increment_min", "lower"), ("error_of_a_plugin", "larger")])
def test_directions(name, worse):
    assert column(name).worse == worse


def test_timings_are_told_and_bookkeeping_is_hidden():
    for name in ("us_per_step", "wall_time_min_s", "hook_time_s"):
        assert column(name).timing
    assert shown_columns(["dt", "source_hash", "energy_error_max", "traceback"]) == ["dt", "energy_error_max"]


def test_the_headings_of_a_table_are_distinct_or_grouped():
    for table, names in terminal.SHOWN.items():
        headings = [column(name).short for name in names]
        # "stable" and "unstable" stand twice in the stability table: behind "limit" and behind "plain limit"
        assert len(set(headings)) == len(headings) - (2 if table == "stability" else 0), table
