"""Questions and answers of a site with a JSON API, as a source of Lorecrawl."""
