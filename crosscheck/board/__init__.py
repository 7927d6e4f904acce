"""Board: cases by engines by releases: who is right, who was, and who cannot run."""
