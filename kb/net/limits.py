"""What an answer may be at most, whichever client reads it."""

ANSWER_BYTES = 100_000_000  # decoded
ANSWER_S = 300.0
