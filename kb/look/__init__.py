"""What the report and `kb explore` look like: one style sheet, the charts, headings of columns."""
