"""Doors for engines of others: records, programs, Python packages and FMUs, each a full column of the report."""
