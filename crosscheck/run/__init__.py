"""Running engines: child processes, caches, clusters, rows of results."""
