"""What foreign code reads, noted while it runs: a row is used again only while all of that is as it was."""
