"""One local index over everything that is clean: what is in it, how it is asked.

transcripts, sections, threads   clean rows to passages, a source each (kb.search.passage)
build                            passages to index/<source>/
engine                           how tantivy writes an index and is asked; nobody else knows it
words                            what a person types to what is asked
snippet                          the part of a text that says most of what was asked for
rank                             BM25 over several sources as one, words in the order asked first
suggest                          misspelt words, by the words of the indexes
ask                              the best passages of a data root as answers
"""
