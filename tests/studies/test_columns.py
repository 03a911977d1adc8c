"""A study says what its tables are; whoever shows or compares columns asks its `Table`."""

import pytest

from tcbench import Column, Table, TcbenchError
from tcbench.studies.base import table_schemas
from tcbench.studies.columns import column, own_tables
from tcbench.table import from_dict


@pytest.mark.parametrize("name", ["iterations_saved", "gain_over_time_s", "residual_margin", "errors_found"])
def test_of_a_plugins_column_no_direction_is_guessed_from_its_name(name):
    """More iterations saved were a regression."""
    for tables in ((), (Table("mine", (name,)),)):
        assert (column(name, *tables).worse, column(name, *tables).timing) == ("", False)


def test_a_plugins_word_on_its_own_column_is_the_one_that_counts():
    mine = Table("mine", (Column("error", "largest miss", unit="mm", worse="higher"), Column("gain_*", "gain of *")))
    told = column("error", mine)
    assert (told.label, told.worse) == ("largest miss, mm", "higher") != (column("error").label, column("error").worse)
    assert column("gain_area", mine).label == "gain of area"
    assert column("energy_error_max", mine) == column("energy_error_max")
    (bought,) = (table for table in own_tables() if table.name == "bought")
    assert column("over_1e-3", bought).short == "error/1e-3" and "tolerance asked for" in column("over_1e-3").label


@pytest.mark.parametrize("table", own_tables(), ids=lambda table: table.name)
def test_what_a_table_says_of_its_columns_are_columns_of_it(table):
    assert {*table.key, *table.terminal} <= {*table.names, "tolerance"} or not table.columns
    heads = [column(name, table).short for name in table.terminal]
    # "stable" and "unstable" stand twice in the stability table: behind "limit" and behind "plain limit"
    assert len(set(heads)) == len(heads) - (2 if table.name == "stability" else 0)


@pytest.mark.parametrize("table", own_tables(), ids=lambda table: table.name)
def test_a_table_comes_back_from_a_run_folder_as_it_was(table):
    assert from_dict(table.as_dict()) == table


@pytest.mark.parametrize("data", [None, {"name": 1}, {"name": "a", "columns": [{"nope": 1}]}, {"name": "a", "x": 2}])
def test_a_damaged_folder_declares_no_table(data):
    assert from_dict(data) is None and "conservation" in table_schemas({"tables": {"mine": [data]}})


def test_a_mistake_in_a_table_is_named_where_it_is_made():
    with pytest.raises(TcbenchError, match=r"The column 'a': worse is one of .* not 'up'"):
        Column("a", worse="up")
    with pytest.raises(TcbenchError, match="The table 'a': columns is a tuple of Column or of names, not"):
        Table("a", columns=["dt"])
