"""Archive dumps of Reddit: files → the records that are wanted."""
