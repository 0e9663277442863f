"""Figures that say how good each pair is: pairs/quality.

hashed_words      words and runs of words as numbers, a batch of transcripts at once
near_duplicates   videos that say nearly the same
recurring_text    what a channel says in several of its videos
text_figures      language, verbs, keywords and speed of a pair's text
build             the files of a part, and the table made of all parts
"""
