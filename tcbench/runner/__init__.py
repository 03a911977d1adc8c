"""Cells to rows to tables: planning, workers, deadlines, reuse, the run folder."""
