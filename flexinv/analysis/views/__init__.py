"""Views of a solution: its card, its figures, its moving picture."""
