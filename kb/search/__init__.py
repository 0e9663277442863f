"""One local index over all clean texts, and questions to it.

passage          the unit that is indexed and shown; kb.<source>.passages makes them
build            passages → index/<source>/
tantivy_index    writes and reads an index by tantivy
query            parses a query
ranking          BM25 over several sources as one; titles and words in the order asked come first
answers          the best passages of a data root, with snippets; also within what is linked to an
                 entity; spelling by the words of the indexes
"""
