"""Charts: a table in, a matplotlib Figure out. No pyplot, no computing, no saving, no conclusions in titles."""
