"""A sample that people judge in Label Studio, and their answers as a table and as figures."""
