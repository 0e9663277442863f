"""Tasks: what the titles of kept videos say that is done in them, as prompts with times.

titles    a title → its prompt and object, or the reasons why it gives none
times     when the task begins and ends: chapters of the description, mentions in the transcript
build     clean/youtube → tasks/tasks-*.parquet and tasks/titles-*.parquet
"""
