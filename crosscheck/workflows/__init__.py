"""Whole jobs: a night, the newest engines, new mechanisms, their summary and proposed limits."""
