"""Known changes of packages, found by `crosscheck bisect` from the index of this machine."""
