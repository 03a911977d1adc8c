"""Rows on disk, and what is read back from them: tables, provenance, comparisons."""
