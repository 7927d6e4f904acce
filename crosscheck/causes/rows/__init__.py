"""The dictionary of causes, a table for each topic: a row is a cause."""
