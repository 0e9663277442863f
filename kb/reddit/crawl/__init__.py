"""Asks Reddit, and imports archive dumps: what fills the raw log."""
