"""One local index over everything that is clean: what is in it, how it is asked.

transcripts, sections, threads   clean rows to passages, a source each (kb.search.passage)
build                            passages to index/<source>.sqlite, by SQLite's FTS5
words                            what a person types to what FTS5 is asked; nothing is an error
rank                             BM25 over several sources with one set of statistics
ask                              the best passages of a data root as answers
"""
