"""What is best on a map: exact shortest paths, trade-offs and bounds."""
