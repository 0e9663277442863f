"""Columns added beside the rows: toxicity scores (cached by text) and word counts."""
