"""What is exactly true: states with a certified error bar."""
