"""What the commands do, and the options that they share."""
