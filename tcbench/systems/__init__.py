"""The physics: systems, scenarios, their right-hand sides and momenta."""
