"""Cells to rows: planning, workers, deadlines, resuming."""
