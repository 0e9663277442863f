"""Values of columns of videos that several rooms compare with."""

# What decided the topic of videos that are known to be about it: YouTube's label, or the profile,
# which takes imported videos as meant. `keywords` only make it likely.
BY_LABEL, BY_PROFILE, BY_KEYWORDS = "game_label", "profile", "keywords"
TOPIC_KNOWN = (BY_LABEL, BY_PROFILE)
# Who may see a video or playlist where that is not everybody, in the words of YouTube's API and of
# yt-dlp. The id of an unlisted one is its only lock, so it must not be given away.
NOT_PUBLIC = ("private", "unlisted", "needs_auth", "premium_only", "subscriber_only")
