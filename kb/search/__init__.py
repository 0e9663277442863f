"""One local index over all clean texts, and questions to it.

youtube_passages, wiki_passages, reddit_passages   clean rows → passages of each source
passage          what is found and shown
build            passages → index/<source>/
tantivy_index    writes and reads an index by tantivy
query            what a person types → what is asked
ranking          BM25 over several sources as one; words in the order asked come first
snippet          the part of a text that says most of what was asked for
spelling         misspelt words, by the words of the indexes
answers          the best passages of a data root, also within what is linked to an entity
"""
