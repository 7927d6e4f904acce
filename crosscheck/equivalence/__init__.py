"""Two descriptions of a machine: matched, compared, and the differences named so that they make one of the other."""
