"""Plugins into a registry: their files are imported, and what they bring is kept by name."""
