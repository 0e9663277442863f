"""Keyword-matched video-text pairs (MineDojo paper, appendix: video-text pairs).

    keyword_list       a profile's list: its rows, their forms, and what is wrong with them
    keywords           the list with all forms, kinds and rules for everyday words
    transcripts        reads clean transcripts in batches
    transcript_batch   a batch as one run of bytes, with the times of its cues
    matching           whole words, leftmost-longest, case and punctuation evened out
    seeded_random      random numbers by seed and position; which clips are kept
    clip_tokens        CLIP tokens of words, and the text around a match
    extract            all of these on one batch of transcripts → rows of pairs/pairs
    build              every batch of clean/youtube/transcripts → pairs/pairs-*.parquet
    repeated_text      videos that say nearly the same; what a channel says in each of its videos
    quality            figures that say how good each pair is → pairs/quality-*.parquet
    measures           how well speech recognition hears the keywords
    restore            a released index and one's own transcripts → pairs with text
    keyword_hits       hits per keyword with examples, for a person to judge the list
    keyword_proposal   rows of a list, proposed from a wiki's page titles

Work is done on whole batches with numpy and Arrow.
"""
