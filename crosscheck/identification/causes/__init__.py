"""Causes of what a model leaves unexplained in a measured log, named with size and evidence."""
