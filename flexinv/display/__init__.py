"""How results show themselves: lines of text, and cards of HTML and SVG for notebooks; figures and moving pictures."""
