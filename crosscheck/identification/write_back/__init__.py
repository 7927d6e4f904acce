"""Write back: the user's own robot file with what was identified; all else stays, byte by byte."""
