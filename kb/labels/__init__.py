"""A sample that people judge, in the browser or in Label Studio, and what their answers say."""
