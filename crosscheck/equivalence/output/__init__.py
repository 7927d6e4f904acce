"""Comparisons for readers: text, Markdown, a page, JUnit, and what to write in which file."""
