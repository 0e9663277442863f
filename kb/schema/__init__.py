"""Reads `schemas/`, the one source of truth for every table and raw answer.

`table("youtube/videos")` gives a declared table, `tables()` all of them. Arrow schemas, the
check of what code writes (`conform`), DuckDB views, the column reference and Croissant fields are
derived from them; `raw` holds the JSON Schemas of raw answers.
"""

from kb.schema.tables import Column, Table, conform, released_tables, table, tables

__all__ = ["Column", "Table", "conform", "released_tables", "table", "tables"]
