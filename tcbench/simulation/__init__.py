"""One integrator on one scenario: loops, records, trajectories, metrics."""
