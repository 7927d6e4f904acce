"""From records to verdicts: comparisons, results, the blessed baseline, the history of nights."""
