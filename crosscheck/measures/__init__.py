"""Measures: records, metrics, spectra, limits, error bars, certificates."""
