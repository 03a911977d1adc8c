"""What is exactly true: certified states, by unrelated methods."""
