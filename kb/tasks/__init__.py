"""Tasks: what the titles of kept videos say that is done in them, as prompts with times.

titles   a title → its prompt and object, or the reasons why it gives none
build    clean/youtube and labels → tasks/tasks-*.parquet and tasks/titles-*.parquet
"""
