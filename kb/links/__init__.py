"""Entities, and where the three sources speak of them (contract: links).

    texts      rows of clean tables → texts in batches, as the matcher takes them
    build      all clean tables → links/entities-*.parquet and links/links-*.parquet

The matcher is that of the pairs (kb.pairs.matching), with the same keywords, forms and rules for
everyday words. Work is done on whole batches with numpy and Arrow.
"""
