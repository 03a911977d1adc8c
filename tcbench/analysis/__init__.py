"""What runs and formulas show: orders, largest steps, conditions of the theory, times, statistics."""
