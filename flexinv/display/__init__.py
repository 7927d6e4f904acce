"""Display of results: lines of text, cards of HTML and SVG for notebooks, figures and moving pictures."""
