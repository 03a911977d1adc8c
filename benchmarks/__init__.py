"""The asv suite over the commits: every_commit.py is what `asv run` does, every_method.py what `--bench` adds."""
