"""Raw answers of Reddit → rows of posts and comments."""
