"""Example plugins for tcbench."""
