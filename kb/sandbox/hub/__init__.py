"""A hub of data sets, as the Hugging Face hub answers its own client."""
