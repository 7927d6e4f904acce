"""Proofs: each lifted mechanism held against the reader's own model, and what the models do beside, by name."""
