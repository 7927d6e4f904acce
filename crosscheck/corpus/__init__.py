"""Corpus of check cases: kits with consensus values, who agrees and who does not, audited bars, and judging of answers."""
