"""The scenarios that the package has references of, as their file says: name -> constants, initial data, times."""

from tcbench.reference.certified import stored_file

SCENARIOS = {name: (r["constants"], r["initial"], tuple(r["times"])) for name, r in stored_file()["scenarios"].items()}
