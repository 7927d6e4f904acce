"""Faults of logs: machines of known truth are logged, a log is spoiled, and what identify names is judged."""
