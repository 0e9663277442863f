"""Commands that exist once for each source: crawl, filter, export, annotate, refresh, purge."""
