"""Reddit: posts and comments of one subreddit, live (PRAW) or from archive dumps."""
