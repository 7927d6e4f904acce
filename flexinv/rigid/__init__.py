"""Torques of many samples: prepared functions, derivatives, regressors, and the threads that share the work."""
