"""The public verbs: solve, simulate, statics, batches, controllers, and the solutions that they return."""
