"""Links that bend, compared: held in their stress-free shape for the rest of a machine, their sections and lengths by name."""
