"""Reports: pages, a Markdown summary and a JUnit file, all from ``results.json``."""
