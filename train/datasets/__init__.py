"""Data sets to learn from: labelled episodes and the frozen scenes, with their metadata."""
